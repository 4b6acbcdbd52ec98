"""The estimator node: computes the state of the joints from encoders."""

import numpy as np
from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import ObkJointEncoders
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.time import Time

from arm_py.law import smoothed
from obelisk_py.core.estimation import ObeliskEstimator
from obelisk_py.core.parameter import Parameter
from obelisk_py.core.utils.ros import spin_obelisk

__all__ = ["ArmEstimator", "main"]


class ArmEstimator(ObeliskEstimator):
    """Publishes the measured angles and smoothed speeds."""

    time_constant_s = Parameter(
        0.005, ge=0.001, le=0.1, unit="s", description="time constant of the speed filter"
    )

    last: ObkJointEncoders | None = None
    """The latest reading."""
    speeds: np.ndarray
    """Smoothed joint speeds [rad/s], shape (6,); set by the first reading."""

    def __init__(self, node_name: str = "arm_estimator") -> None:
        """Create the node; its topics and rates come from the config."""
        super().__init__(node_name, est_msg_type=EstimatedState)
        self.register_obk_subscription(
            "sub_encoders_setting",
            self.encoders_callback,
            key="sub_encoders",
            msg_type=ObkJointEncoders,
        )

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Discard earlier readings."""
        self.last = None
        return super().on_configure(state)

    def encoders_callback(self, msg: ObkJointEncoders) -> None:
        """Smooth the speeds of each reading."""
        measured = np.array(msg.joint_vel)
        if self.last is None:
            self.speeds = measured
        else:
            period = Time.from_msg(msg.stamp) - Time.from_msg(self.last.stamp)
            period_s = period.nanoseconds * 1e-9
            self.speeds = smoothed(self.speeds, measured, period_s, self.time_constant_s)
        self.last = msg

    def compute_state_estimate(self) -> EstimatedState | None:
        """Publish the estimate, starting with the first reading."""
        if self.last is None:
            return None
        msg = EstimatedState(joint_names=self.last.joint_names, q_joints=self.last.joint_pos)
        msg.header.stamp = self.last.stamp
        msg.v_joints = self.speeds.tolist()
        self.obk_publishers["pub_est"].publish(msg)
        return msg


def main(args: list[str] | None = None) -> None:
    """Run the node until it is stopped."""
    spin_obelisk(args, ArmEstimator)
