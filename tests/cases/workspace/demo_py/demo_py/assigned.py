from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.parameter import Parameter
from obelisk_py.core.utils.ros import spin_obelisk


class Assigned(ObeliskController):
    kp = Parameter(5.0)

    def __init__(self, node_name: str = "assigned") -> None:
        super().__init__(node_name, PositionSetpoint, EstimatedState)
        self.kp = 6.0
        self.u = [self.kp]

    def update_x_hat(self, x_hat_msg: EstimatedState) -> None:
        self.x_hat = x_hat_msg

    def compute_control(self) -> PositionSetpoint:
        msg = PositionSetpoint()
        msg.u_mujoco = self.u
        self.obk_publishers["pub_ctrl"].publish(msg)
        return msg


def main() -> None:
    spin_obelisk(None, Assigned)
