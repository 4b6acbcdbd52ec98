from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.utils.ros import spin_obelisk


class ArmController(ObeliskController):
    def __init__(self, node_name: str = "arm_controller") -> None:
        super().__init__(node_name, PositionSetpoint, EstimatedState)
        self.declare_parameter("gain", 1.0)
        self.declare_parameters("limits", [("speed", 1.0)])

    def update_x_hat(self, x_hat_msg: EstimatedState) -> None:
        self.x_hat = x_hat_msg

    def compute_control(self) -> PositionSetpoint:
        msg = PositionSetpoint()
        msg.u_mujoco = [0.0]
        self.obk_publishers["pub_ctrl"].publish(msg)
        return msg


def main() -> None:
    spin_obelisk(None, ArmController)
