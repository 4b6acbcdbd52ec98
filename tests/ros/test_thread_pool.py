"""rclpy's executor with threads, while transitions cancel and destroy timers that are due."""

from typing import Any

import pytest
from rclpy.executors import MultiThreadedExecutor

from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.spinning import _make_executor

from .stack import parameters, request, spinning

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("ros_domain")]

TIMERS = 8
ROUNDS = 40


class Busy(ObeliskNode):
    """Timers that are always due."""

    def __init__(self, **given: Any) -> None:
        settings = {f"timer_{n}_setting": "{timer_period_sec: 0.0005}" for n in range(TIMERS)}
        super().__init__("busy", **parameters(**settings), **given)
        for name in settings:
            self.register_obk_timer(name, self.pass_by)

    def pass_by(self) -> None:
        """Do nothing."""


def test_a_node_survives_its_transitions() -> None:
    with spinning(Busy, lambda: _make_executor(MultiThreadedExecutor)) as node:
        for _ in range(ROUNDS):
            for transition in ("configure", "activate", "deactivate", "cleanup"):
                assert request(node, transition)
