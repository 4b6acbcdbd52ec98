from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import JointEncoders

from obelisk_py.core.estimation import ObeliskEstimator
from obelisk_py.core.utils.ros import spin_obelisk


class Estimator(ObeliskEstimator):
    def __init__(self, node_name: str = "estimator") -> None:
        super().__init__(node_name, EstimatedState)
        self.register_obk_subscription(
            "sub_sensor_setting", self.on_joints, key="sub_sensor", msg_type=JointEncoders
        )

    def on_joints(self, msg: JointEncoders) -> None:
        self.joints = msg.y

    def compute_state_estimate(self) -> EstimatedState:
        msg = EstimatedState(q_joints=self.joints)
        self.obk_publishers["pub_est"].publish(msg)
        return msg


def main() -> None:
    spin_obelisk(None, Estimator)
