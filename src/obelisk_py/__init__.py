"""The run-time library of Obelisk: the classes that a node inherits from, and the MuJoCo robot.

Importing it gives the message classes the field names of their older layouts back
(`PositionSetpoint.u`, `EstimatedState.x_hat`); the wire format does not change.
"""

from obelisk_py.core.messages import add_field_aliases

add_field_aliases()
