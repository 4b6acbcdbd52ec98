from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_sensor_msgs.msg import JointEncoders, ObkImu

from obelisk_py.core.robot import ObeliskRobot
from obelisk_py.core.utils.ros import spin_obelisk


class Arm(ObeliskRobot):
    def __init__(self, node_name: str = "arm") -> None:
        super().__init__(node_name, ctrl_msg_type=PositionSetpoint)
        self.register_obk_publisher("pub_joints_setting", key="pub_joints", msg_type=JointEncoders)
        self.register_obk_publisher("pub_imu_setting", key="pub_imu", msg_type=ObkImu)

    def apply_control(self, control_msg: PositionSetpoint) -> None:
        self.control = control_msg


def main() -> None:
    spin_obelisk(None, Arm)
