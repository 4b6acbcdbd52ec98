from obelisk_control_msgs.msg import PositionSetpoint

from demo_py.controller import ArmController
from obelisk_py.core.utils.ros import spin_obelisk


class WrongKeyController(ArmController):
    def compute_control(self) -> PositionSetpoint:
        msg = PositionSetpoint(u_mujoco=[0.0])
        self.obk_publishers["pub_ctl"].publish(msg)
        return msg


def main() -> None:
    spin_obelisk(None, WrongKeyController)
