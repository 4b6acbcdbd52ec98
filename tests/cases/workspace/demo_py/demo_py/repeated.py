from obelisk_control_msgs.msg import PositionSetpoint

from demo_py.controller import ArmController
from obelisk_py.core.utils.ros import spin_obelisk

LEGS = 2


class RepeatedController(ArmController):
    def compute_control(self) -> PositionSetpoint:
        msg = PositionSetpoint()
        msg.u_mujoco = [0.0] * (LEGS * 2)
        self.obk_publishers["pub_ctrl"].publish(msg)
        return msg


def main() -> None:
    spin_obelisk(None, RepeatedController)
