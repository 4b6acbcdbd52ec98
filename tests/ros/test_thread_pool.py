"""rclpy's executors: transitions that destroy timers which are due, and spinning for long."""

from collections.abc import Callable
from typing import Any

import pytest
import rclpy
from rclpy.executors import Executor, MultiThreadedExecutor, SingleThreadedExecutor

from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.spinning import _End, _make_executor

from .stack import DEADLINE_S, parameters, request, spinning

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


@pytest.mark.parametrize("kind", [SingleThreadedExecutor, MultiThreadedExecutor])
def test_spinning_keeps_nothing_of_the_callbacks_that_ran(kind: Callable[[], Executor]) -> None:
    rclpy.init()
    node, executor, over = rclpy.create_node("ticking"), _make_executor(kind), _End()
    kept: list[int] = []

    def tick() -> None:
        kept.append(len(over._callbacks))
        if len(kept) == 50:
            over.set_result(None)

    node.create_timer(0.001, tick)
    executor.add_node(node)
    executor.spin_until_future_complete(over, timeout_sec=DEADLINE_S)
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()
    assert over.done()
    assert set(kept[:50]) == {1}
