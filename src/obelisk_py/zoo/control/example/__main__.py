"""Runs `ExamplePositionSetpointController` as a process."""

from obelisk_py.core.utils.ros import spin_obelisk
from obelisk_py.zoo.control.example.example_position_setpoint_controller import (
    ExamplePositionSetpointController,
)

spin_obelisk(None, ExamplePositionSetpointController)
