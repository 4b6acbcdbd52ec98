from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_sensor_msgs.msg import ObkImu

from demo_py.controller import ArmController
from obelisk_py.core.utils.ros import spin_obelisk


class EagerController(ArmController):
    def __init__(self, node_name: str = "eager_controller") -> None:
        super().__init__(node_name)
        self.register_obk_timer(
            "timer_report_setting", lambda event: print(event), default="timer_period_sec:1.0"
        )
        self.register_obk_subscription("sub_imu", self.on_imu, ObkImu, required=False)
        self.register_obk_subscription("sub_spare", self.on_imu, ObkImu, required=False)

    def on_imu(self) -> None:
        self.get_logger().info("received")

    def compute_control(self, time_s: float) -> PositionSetpoint:  # type: ignore[override]
        return super().compute_control()


def main() -> None:
    spin_obelisk(None, EagerController)
