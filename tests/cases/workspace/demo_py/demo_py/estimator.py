from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import JointEncoders, ObkImu

from obelisk_py.core.estimation import ObeliskEstimator
from obelisk_py.core.utils.ros import spin_obelisk


class ArmEstimator(ObeliskEstimator):
    def __init__(self, node_name: str = "arm_estimator") -> None:
        super().__init__(node_name, EstimatedState)
        self.register_obk_subscription(
            "sub_sensor_setting", self.on_joints, key="sub_sensor", msg_type=JointEncoders
        )
        self.register_obk_subscription(
            "sub_imu_setting", self.on_imu, key="sub_imu", msg_type=ObkImu, required=False
        )

    def on_joints(self, msg: JointEncoders) -> None:
        self.joints = msg.y

    def on_imu(self, msg: ObkImu) -> None:
        self.imu = msg

    def compute_state_estimate(self) -> EstimatedState:
        msg = EstimatedState(q_joints=self.joints)
        self.obk_publishers["pub_est"].publish(msg)
        return msg


def main() -> None:
    spin_obelisk(None, ArmEstimator)
