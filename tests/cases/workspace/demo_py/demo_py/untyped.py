from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.utils.ros import spin_obelisk


class UntypedController(ObeliskController):
    def __init__(self, node_name: str = "untyped") -> None:
        super().__init__(node_name)

    def update_x_hat(self, x_hat_msg: EstimatedState) -> None:
        self.x_hat = x_hat_msg

    def compute_control(self) -> PositionSetpoint:
        msg = PositionSetpoint(u_mujoco=[0.0])
        self.obk_publishers["pub_ctrl"].publish(msg)
        return msg


def main() -> None:
    spin_obelisk(None, UntypedController)
