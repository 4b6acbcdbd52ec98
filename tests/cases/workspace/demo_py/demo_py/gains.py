from obelisk_control_msgs.msg import PDFeedForward
from obelisk_estimator_msgs.msg import EstimatedState

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.parameter import Parameter
from obelisk_py.core.utils.ros import spin_obelisk


class Gains(ObeliskController):
    kp = Parameter(5.0)

    def __init__(self, node_name: str = "gains") -> None:
        super().__init__(node_name, PDFeedForward, EstimatedState)

    def update_x_hat(self, x_hat_msg: EstimatedState) -> None:
        self.x_hat = x_hat_msg

    def compute_control(self) -> PDFeedForward:
        msg = PDFeedForward()
        msg.kp = msg.kd = [self.kp, self.kp]
        self.obk_publishers["pub_ctrl"].publish(msg)
        return msg


def main() -> None:
    spin_obelisk(None, Gains)
