from functools import partial
from typing import Any

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
        self.register_obk_timer("timer_named_setting", lambda x=1: print(x), default=PERIOD)
        self.register_obk_timer("timer_bound_setting", partial(self.note, 1), default=PERIOD)
        self.register_obk_timer("timer_waiting_setting", self.wait, default=PERIOD)
        self.register_obk_timer("timer_ros_setting", self.get_clock, default=PERIOD)

    def update_x_hat(self, x_hat_msg: Any, info: Any) -> None:  # type: ignore[override]
        self.note(info, x_hat_msg)

    def note(self, *values: Any) -> None:
        self.noted = values

    async def wait(self, time_s: float = 1.0) -> None:
        self.note(time_s)


def main() -> None:
    spin_obelisk(None, CallbacksController)
