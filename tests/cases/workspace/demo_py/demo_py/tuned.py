from enum import Enum

from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.parameter import Parameter
from obelisk_py.core.utils.ros import spin_obelisk

STIFFEST = 200.0


class Gait(Enum):
    TROT = "trot"
    STAND = "stand"


class Damped(ObeliskController):
    kp = Parameter(5.0)
    damping = Parameter(2.0, ge=0.0, unit="N m s/rad")


class Tuned(Damped):
    kp = Parameter(20.0, ge=0.0, le=STIFFEST, unit="N m/rad", description="stiffness")
    kd = Parameter(2.0)
    gains = Parameter([1.0, 2.0], ge=0.0)
    weights = Parameter((50, 1.0, 5.0))
    gait = Parameter(Gait.TROT)
    steps: int = Parameter(3, live=False)

    def __init__(self, node_name: str = "tuned") -> None:
        super().__init__(node_name, PositionSetpoint, EstimatedState)

    def update_x_hat(self, x_hat_msg: EstimatedState) -> None:
        self.x_hat = x_hat_msg

    def compute_control(self) -> PositionSetpoint:
        msg = PositionSetpoint()
        msg.u_mujoco = [self.kp]
        self.obk_publishers["pub_ctrl"].publish(msg)
        return msg


def main() -> None:
    spin_obelisk(None, Tuned)
