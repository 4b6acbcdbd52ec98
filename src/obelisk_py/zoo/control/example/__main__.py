"""Run `ExamplePositionSetpointController` as a process."""

from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.utils.ros import spin_obelisk
from obelisk_py.zoo.control.example.example_position_setpoint_controller import (
    ExamplePositionSetpointController,
)


class TypedController(ExamplePositionSetpointController):
    """Sets the message types, because existing configs of this executable omit them."""

    def __init__(self, node_name: str = "example_position_setpoint_controller") -> None:
        """Create the node; the base class's constructor would take the types from the config."""
        ObeliskController.__init__(self, node_name, PositionSetpoint, EstimatedState)


if __name__ == "__main__":
    spin_obelisk(None, TypedController)
