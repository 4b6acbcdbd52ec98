"""Run `JointEncodersPassthroughEstimator` as a process."""

from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import JointEncoders

from obelisk_py.core.estimation import ObeliskEstimator
from obelisk_py.core.utils.ros import spin_obelisk
from obelisk_py.zoo.estimation.jointencoders_passthrough_estimator import (
    JointEncodersPassthroughEstimator,
)


class TypedEstimator(JointEncodersPassthroughEstimator):
    """Sets the message types, because existing configs of this executable omit them."""

    def __init__(self, node_name: str = "joint_encoders_passthrough_estimator") -> None:
        """Create the node; the base class's constructor would take the types from the config."""
        ObeliskEstimator.__init__(self, node_name, EstimatedState)
        self.register_obk_subscription(
            "sub_sensor_setting",
            self.joint_encoder_callback,
            key="subscriber_sensor",
            msg_type=JointEncoders,
        )


if __name__ == "__main__":
    spin_obelisk(None, TypedEstimator)
