"""The run-time library of Obelisk: the classes that a node inherits from, and the MuJoCo robot.

Importing it gives the message classes the field names of their older layouts back
(`PositionSetpoint.u`, `EstimatedState.x_hat`); the wire format does not change.
"""

import importlib.util

from obelisk_py.core.messages import add_field_aliases

# `obelisk_py.recordings` works without ROS too.
if importlib.util.find_spec("rclpy") is not None:
    add_field_aliases()
