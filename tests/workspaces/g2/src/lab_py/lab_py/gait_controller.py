"""High level: publishes the gait."""

from lab_msgs.msg import Gait
from obelisk_estimator_msgs.msg import EstimatedState
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.utils.ros import spin_obelisk


class GaitController(ObeliskController):
    def __init__(self, node_name: str = "gait_controller") -> None:
        super().__init__(node_name, Gait, EstimatedState)
        self.declare_parameter("amplitude", 0.8)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        super().on_configure(state)
        self.amplitude = self.get_parameter("amplitude").get_parameter_value().double_value
        # The topic of this controller, for the log.
        text = self.get_parameter("pub_ctrl_setting").get_parameter_value().string_value
        settings = {}
        for entry in text.split(","):
            name, value = entry.split(":")
            settings[name] = value
        self.get_logger().info(f"{self.node_name} publishes on {settings['topic']}")
        return TransitionCallbackReturn.SUCCESS

    def update_x_hat(self, x_hat_msg: EstimatedState) -> None:
        self.x_hat = x_hat_msg.q_joints

    def compute_control(self) -> Gait:
        msg = Gait()
        msg.amplitude = self.amplitude
        msg.frequency = 0.5
        self.obk_publishers["pub_ctrl"].publish(msg)
        return msg


def main(args: list[str] | None = None) -> None:
    spin_obelisk(args, GaitController, SingleThreadedExecutor)


if __name__ == "__main__":
    main()
