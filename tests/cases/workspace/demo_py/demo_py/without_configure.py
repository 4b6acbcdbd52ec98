from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from demo_py.controller import ArmController
from obelisk_py.core.utils.ros import spin_obelisk


class IdleController(ArmController):
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.gain = self.get_parameter("gain").value
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.gain = None
        return TransitionCallbackReturn.SUCCESS


def main() -> None:
    spin_obelisk(None, IdleController)
