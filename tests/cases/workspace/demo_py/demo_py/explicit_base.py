from typing import Any

from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from demo_py.controller import ArmController
from obelisk_py.core.utils.ros import spin_obelisk


class Counted:
    def __init__(self) -> None:
        self.count = 0


class CountedController(Counted, ArmController):
    """Calls each base class by its name."""

    def __init__(self, *args: Any) -> None:
        Counted.__init__(self)
        self.start(*args)

    def start(self, *args: Any) -> None:
        ArmController.__init__(self, *args)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.count += 1
        return self.prepare(state)

    def prepare(self, state: LifecycleState) -> TransitionCallbackReturn:
        return ArmController.on_configure(self, state)


def main() -> None:
    spin_obelisk(None, CountedController)
