from obelisk_control_msgs.msg import PositionSetpoint

from demo_py.controller import ArmController
from obelisk_py.core.utils.ros import spin_obelisk


class OneRepeatedController(ArmController):
    """Fills its messages with one value, or with a number of values known only at run time."""

    JOINTS = 1

    def compute_control(self) -> PositionSetpoint:
        msg = PositionSetpoint()
        msg.u_mujoco = [0.0] * self.JOINTS
        msg.u_mujoco = [0.0] * self.count()
        msg.u_mujoco = [joint for joint in range(3) if joint < self.JOINTS]
        grown = PositionSetpoint()
        grown.u_mujoco = [0.0] * 0
        grown.u_mujoco.append(1.0)
        self.obk_publishers["pub_ctrl"].publish(msg)
        return msg

    def count(self) -> int:
        return len(self.x_hat.q_joints)


def main() -> None:
    spin_obelisk(None, OneRepeatedController)
