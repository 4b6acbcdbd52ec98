"""Timers that start in step: which moment of the steady clock each stage of the loop gets."""

from types import SimpleNamespace

import pytest
from rclpy.clock_type import ClockType

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.estimation import ObeliskEstimator
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.timer_phase import LoopStage, start_in_step

PERIOD_NS = 1_000_000


class StoppedTimer:
    """Starts as an rcl timer does: a reset adds the period that it has to the present time."""

    def __init__(self, now_ns: int, clock_type: ClockType) -> None:
        self.clock = SimpleNamespace(
            clock_type=clock_type, now=lambda: SimpleNamespace(nanoseconds=now_ns)
        )
        self.timer_period_ns = PERIOD_NS
        self.first_ns = 0

    def reset(self) -> None:
        self.first_ns = self.clock.now().nanoseconds + self.timer_period_ns


@pytest.mark.parametrize("now_ns", [0, 1, 100_000, 777_777, 123_456_789_012_345])
@pytest.mark.parametrize("stage", LoopStage)
def test_the_first_call_is_within_a_period_at_the_phase_of_the_stage(
    now_ns: int, stage: LoopStage
) -> None:
    timer = StoppedTimer(now_ns, ClockType.STEADY_TIME)
    start_in_step(timer, stage)  # type: ignore[arg-type]
    assert now_ns < timer.first_ns <= now_ns + PERIOD_NS
    assert timer.first_ns % PERIOD_NS == stage * PERIOD_NS // 8
    assert timer.timer_period_ns == PERIOD_NS


def test_simulated_time_is_left_as_it_is() -> None:
    timer = StoppedTimer(777_777, ClockType.ROS_TIME)
    start_in_step(timer, LoopStage.CONTROL)  # type: ignore[arg-type]
    assert timer.first_ns == 777_777 + PERIOD_NS


def test_an_estimator_ticks_after_its_sensors_and_before_its_controller() -> None:
    assert ObeliskNode.loop_stage < ObeliskEstimator.loop_stage < ObeliskController.loop_stage
