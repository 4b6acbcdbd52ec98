"""The estimator node: computes the state of cart and pole from encoders."""

from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import ObkJointEncoders
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from obelisk_py.core.estimation import ObeliskEstimator
from obelisk_py.core.utils.ros import spin_obelisk

__all__ = ["CartPoleEstimator", "main"]


class CartPoleEstimator(ObeliskEstimator):
    """Publishes the encoder values as the state of the joints."""

    last: ObkJointEncoders | None = None
    """The latest reading."""

    def __init__(self, node_name: str = "cartpole_estimator") -> None:
        """Create the node; its topics and rates come from the config."""
        super().__init__(node_name, est_msg_type=EstimatedState)
        self.register_obk_subscription(
            "sub_encoders_setting",
            self.encoders_callback,
            key="sub_encoders",
            msg_type=ObkJointEncoders,
        )

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Discard readings of an earlier run."""
        self.last = None
        return super().on_configure(state)

    def encoders_callback(self, msg: ObkJointEncoders) -> None:
        """Store the latest reading."""
        self.last = msg

    def compute_state_estimate(self) -> EstimatedState | None:
        """Publish the estimate, starting with the first reading."""
        if self.last is None:
            return None
        msg = EstimatedState(
            joint_names=self.last.joint_names,
            q_joints=self.last.joint_pos,
            v_joints=self.last.joint_vel,
        )
        msg.header.stamp = self.last.stamp
        self.obk_publishers["pub_est"].publish(msg)
        return msg


def main(args: list[str] | None = None) -> None:
    """Run the node until it is stopped."""
    spin_obelisk(args, CartPoleEstimator)
