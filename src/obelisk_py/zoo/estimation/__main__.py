"""Runs `JointEncodersPassthroughEstimator` as a process."""

from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import JointEncoders

from obelisk_py.core.estimation import ObeliskEstimator
from obelisk_py.core.utils.ros import spin_obelisk
from obelisk_py.zoo.estimation.jointencoders_passthrough_estimator import (
    JointEncodersPassthroughEstimator,
)


class TypedEstimator(JointEncodersPassthroughEstimator):
    """Names its message types: existing configs of this executable leave them out."""

    def __init__(self, node_name: str = "joint_encoders_passthrough_estimator") -> None:
        """Make the node; the listing's constructor would leave the types to the config."""
        ObeliskEstimator.__init__(self, node_name, EstimatedState)
        self.register_obk_subscription(
            "sub_sensor_setting",
            self.joint_encoder_callback,
            key="subscriber_sensor",
            msg_type=JointEncoders,
        )


if __name__ == "__main__":
    spin_obelisk(None, TypedEstimator)
