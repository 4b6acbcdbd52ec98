"""The hardware drive of the joint."""

from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_sensor_msgs.msg import JointEncoders
from rclpy.executors import SingleThreadedExecutor

from obelisk_py.core.robot import ObeliskRobot
from obelisk_py.core.utils.ros import spin_obelisk


class LabRobot(ObeliskRobot):
    def __init__(self, node_name: str = "lab_robot") -> None:
        super().__init__(node_name)
        self.position = 0.0
        self.register_obk_publisher("pub_sensor_setting", key="pub_sensor", msg_type=JointEncoders)
        self.register_obk_timer("timer_sensor_setting", self.read_encoders, key="timer_sensor")

    def apply_control(self, control_msg: PositionSetpoint) -> None:
        self.position += 0.01 * control_msg.u[0]

    def read_encoders(self) -> None:
        msg = JointEncoders()
        msg.y = [self.position]
        self.obk_publishers["pub_sensor"].publish(msg)


def main(args: list[str] | None = None) -> None:
    spin_obelisk(args, LabRobot, SingleThreadedExecutor)


if __name__ == "__main__":
    main()
