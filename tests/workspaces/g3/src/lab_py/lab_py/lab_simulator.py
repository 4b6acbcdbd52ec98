"""A custom simulator: one joint that integrates its velocity."""

import time

from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_sensor_msgs.msg import ObkJointEncoders
from rclpy.executors import MultiThreadedExecutor

from obelisk_py.core.robot import ObeliskSimRobot
from obelisk_py.core.utils.ros import spin_obelisk


class LabSimulator(ObeliskSimRobot):
    def __init__(self, node_name: str = "lab_simulator") -> None:
        super().__init__(node_name, PositionSetpoint)
        self.position = 0.0
        self.register_obk_publisher("pub_sensor", ObkJointEncoders)
        self.register_obk_timer("timer_sensor", self.read_encoders)

    def apply_control(self, control_msg: PositionSetpoint) -> None:
        self._set_shared_ctrl(list(control_msg.u_mujoco))

    def run_simulator(self) -> None:
        dt = 0.005
        while True:
            with self.lock:
                ctrl = self.shared_ctrl
                velocity = ctrl[0] if ctrl is not None and len(ctrl) > 0 else 0.0
            self.position += dt * velocity
            time.sleep(dt)

    def read_encoders(self) -> None:
        msg = ObkJointEncoders()
        msg.joint_pos = [self.position]
        self.obk_publishers["pub_sensor"].publish(msg)


def main(args: list[str] | None = None) -> None:
    spin_obelisk(args, LabSimulator, MultiThreadedExecutor)


if __name__ == "__main__":
    main()
