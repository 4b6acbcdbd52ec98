"""Start wall-clock timers in step, so that each node ticks just after the nodes that feed it.

Timers that start at activation have random phases: at 1 kHz a sensor value waits half a
millisecond, on average, for the estimator's tick, and its estimate equally long for the
controller's. Here a timer fires at the multiples of its period on the steady clock, which all
processes on a host share, shifted by an eighth of the period for each stage of the loop before the
node's own.
"""

from enum import IntEnum
from typing import Final

from rclpy.clock_type import ClockType
from rclpy.timer import Timer

__all__ = ["LoopStage", "start_in_step"]

_STAGES_PER_PERIOD: Final = 8


class LoopStage(IntEnum):
    """Where a node stands in the control loop."""

    SENSE = 0
    """Robots and sensors, and nodes that are not part of the loop."""
    ESTIMATE = 1
    CONTROL = 2


def start_in_step(timer: Timer, stage: LoopStage) -> None:
    """Start a stopped timer; its first call comes within one period.

    A timer on a clock other than the steady one starts as in rclpy: simulated time advances in
    steps, which all timers share.

    Source: `rcl_timer_reset` and `rcl_timer_call`, rcl/timer.h of ROS 2 Jazzy: a reset adds the
    period to the current time, and a call adds it to the time at which the timer was due.
    """
    period_ns = timer.timer_period_ns
    if timer.clock.clock_type != ClockType.STEADY_TIME or period_ns < _STAGES_PER_PERIOD:
        timer.reset()
        return
    phase_ns = stage * period_ns // _STAGES_PER_PERIOD
    timer.timer_period_ns = period_ns - (timer.clock.now().nanoseconds - phase_ns) % period_ns
    timer.reset()
    timer.timer_period_ns = period_ns
