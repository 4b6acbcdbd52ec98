import rclpy
from obelisk_control_msgs.msg import PositionSetpoint

from lockstep_py.controller import Controller
from obelisk_py.core.utils.ros import spin_obelisk


class ExecutorController(Controller):
    """Creates a second node, which it spins in its own callback."""

    def __init__(self, node_name: str = "executors") -> None:
        super().__init__(node_name)
        self.second = Controller("second")

    def compute_control(self) -> PositionSetpoint:
        rclpy.spin_once(self.second, timeout_sec=0.0)
        return super().compute_control()


def main() -> None:
    spin_obelisk(None, ExecutorController)
