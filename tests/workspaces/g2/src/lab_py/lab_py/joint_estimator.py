"""Publishes the encoder values as an estimate."""

from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import ObkJointEncoders
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from obelisk_py.core.estimation import ObeliskEstimator
from obelisk_py.core.utils.ros import spin_obelisk


class JointEstimator(ObeliskEstimator):
    def __init__(self, node_name: str = "joint_estimator") -> None:
        super().__init__(node_name, EstimatedState)
        self.register_obk_subscription(
            "sub_sensor_setting", self.encoder_callback, ObkJointEncoders, "sub_sensor"
        )

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        super().on_configure(state)
        self.joints = None
        return TransitionCallbackReturn.SUCCESS

    def encoder_callback(self, msg: ObkJointEncoders) -> None:
        self.joints = msg.joint_pos

    def compute_state_estimate(self):
        msg = EstimatedState()
        if self.joints is not None:
            msg.q_joints = self.joints
            self.obk_publishers["pub_est"].publish(msg)
        return msg


def main(args: list[str] | None = None) -> None:
    spin_obelisk(args, JointEstimator, SingleThreadedExecutor)


if __name__ == "__main__":
    main()
