from demo_py.controller import ArmController
from obelisk_py.core.utils.ros import spin_obelisk


class WrongCallbackController(ArmController):
    def __init__(self, node_name: str = "wrong_callback") -> None:
        super().__init__(node_name)
        self.register_obk_timer("timer_report_setting", self.reprot, default="timer_period_sec:1.0")

    def report(self) -> None:
        self.get_logger().info("running")


def main() -> None:
    spin_obelisk(None, WrongCallbackController)
