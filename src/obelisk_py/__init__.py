"""Obelisk's runtime library: base classes for nodes, and the MuJoCo robot.

Importing the package adds the field names of older message layouts to the message classes
(`PositionSetpoint.u`, `EstimatedState.x_hat`). The wire format does not change.
"""

import importlib.util

from obelisk_py.core.messages import add_field_aliases

# `obelisk_py.recordings` also works without ROS.
if importlib.util.find_spec("rclpy") is not None:
    add_field_aliases()
