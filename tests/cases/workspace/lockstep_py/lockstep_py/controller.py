from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState

from obelisk_py.core.control import ObeliskController


class Controller(ObeliskController):
    """The common base of the controllers of this package."""

    def __init__(self, node_name: str = "controller") -> None:
        super().__init__(node_name, PositionSetpoint, EstimatedState)
        self.declare_parameter("gain", 1.0)

    def update_x_hat(self, x_hat_msg: EstimatedState) -> None:
        self.x_hat = x_hat_msg

    def compute_control(self) -> PositionSetpoint:
        msg = PositionSetpoint(u_mujoco=[0.0])
        self.obk_publishers["pub_ctrl"].publish(msg)
        return msg
