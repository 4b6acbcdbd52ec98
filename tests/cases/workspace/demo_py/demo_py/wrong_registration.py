from demo_py.controller import ArmController
from obelisk_py.core.utils.ros import spin_obelisk


class WrongRegistrationController(ArmController):
    def __init__(self, node_name: str = "wrong_registration") -> None:
        super().__init__(node_name)
        self.register_obk_timer("timer_report_setting", self.report, periode=1.0)

    def report(self) -> None:
        self.get_logger().info("running")


def main() -> None:
    spin_obelisk(None, WrongRegistrationController)
