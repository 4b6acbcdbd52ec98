import time

from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_sensor_msgs.msg import JointEncoders

from obelisk_py.core.robot import ObeliskSimRobot
from obelisk_py.core.utils.ros import spin_obelisk


class Arm(ObeliskSimRobot):
    """A custom simulator, whose loop runs in the thread that the base class starts."""

    def __init__(self, node_name: str = "arm") -> None:
        super().__init__(node_name, ctrl_msg_type=PositionSetpoint)
        self.register_obk_publisher("pub_joints_setting", key="pub_joints", msg_type=JointEncoders)
        self.q, self.u = 0.0, 0.0

    def apply_control(self, control_msg: PositionSetpoint) -> None:
        self.u = control_msg.u_mujoco[0]

    def run_simulator(self) -> None:
        while not self.simulator_stop.is_set():
            self.q += 0.01 * (self.u - self.q)
            self.obk_publishers["pub_joints"].publish(JointEncoders(y=[self.q]))
            time.sleep(0.001)


def main() -> None:
    spin_obelisk(None, Arm)
