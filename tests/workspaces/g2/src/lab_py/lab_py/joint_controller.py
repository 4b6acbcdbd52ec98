"""Low level: follows the gait."""

import os

import numpy as np
import yaml
from ament_index_python.packages import get_package_share_directory
from lab_msgs.msg import Gait
from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState
from rclpy.executors import MultiThreadedExecutor
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.obelisk_typing import ObeliskControlMsg, is_in_bound
from obelisk_py.core.utils.ros import spin_obelisk


class JointController(ObeliskController):
    def __init__(self, node_name: str = "joint_controller") -> None:
        super().__init__(node_name, PositionSetpoint, EstimatedState)
        self.gait = None
        self.position = None
        self.has_moved = False
        self.register_obk_timer(
            "timer_report_setting",
            self.report,
            key="timer_report",
            default_config_str="timer_period_sec:0.2,callback_group:None",
        )

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.register_obk_subscription(
            "sub_gait_setting", self.gait_callback, Gait, key="sub_gait"
        )
        super().on_configure(state)
        share = get_package_share_directory("lab_py")
        with open(os.path.join(share, "gains", "joint.yaml")) as file:
            self.kp = yaml.safe_load(file)["kp"]
        return TransitionCallbackReturn.SUCCESS

    def gait_callback(self, msg: Gait) -> None:
        self.gait = msg

    def report(self) -> None:
        if self.has_moved:
            self.get_logger().info("the joint has moved", once=True)

    def update_x_hat(self, x_hat_msg) -> None:
        if len(x_hat_msg.q_joints) > 0:
            self.position = x_hat_msg.q_joints[0]
            self.has_moved = self.has_moved or abs(self.position) > 0.1

    def compute_control(self):
        msg = PositionSetpoint()
        if self.gait is None or self.position is None:
            return msg
        target = self.gait.amplitude * np.sin(2 * np.pi * self.gait.frequency * self.t)
        msg.u_mujoco = [self.kp * (float(target) - self.position)]
        self.obk_publishers["pub_ctrl"].publish(msg)
        assert is_in_bound(type(msg), ObeliskControlMsg)
        return msg


def main(args: list[str] | None = None) -> None:
    spin_obelisk(args, JointController, MultiThreadedExecutor)


if __name__ == "__main__":
    main()
