from demo_py.controller import ArmController
from obelisk_py.core.utils.ros import spin_obelisk

PERIOD = "timer_period_sec:1.0"


class Reports:
    def report(self) -> None:
        self.reports = 1


class CallbacksController(Reports, ArmController):
    """Callbacks that static analysis can find outside the class."""

    idle = Reports.report

    def __init__(self, node_name: str = "callbacks") -> None:
        super().__init__(node_name)
        self.count = lambda: None
        self.register_obk_timer("timer_report_setting", self.report, default=PERIOD)
        self.register_obk_timer("timer_idle_setting", self.idle, default=PERIOD)
        self.register_obk_timer("timer_count_setting", self.count, default=PERIOD)
        self.register_obk_timer("timer_ros_setting", self.get_clock, default=PERIOD)


def main() -> None:
    spin_obelisk(None, CallbacksController)
