"""High level: publishes the gait."""

from lab_msgs.msg import Gait
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.utils.ros import spin_obelisk


class GaitController(ObeliskController):
    def __init__(self, node_name: str = "gait_controller") -> None:
        super().__init__(node_name)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        super().on_configure(state)
        self.x_hat = None
        return TransitionCallbackReturn.SUCCESS

    def update_x_hat(self, x_hat_msg) -> None:
        self.x_hat = x_hat_msg.x_hat

    def compute_control(self):
        msg = Gait()
        msg.amplitude = 0.8
        msg.frequency = 0.5
        self.obk_publishers["publisher_ctrl"].publish(msg)
        return msg


def main(args: list[str] | None = None) -> None:
    spin_obelisk(args, GaitController, SingleThreadedExecutor)


if __name__ == "__main__":
    main()
