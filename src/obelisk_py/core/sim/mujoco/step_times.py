"""Compute when steps are due, and after which steps samples are taken.

The inputs are a clock, a period, and the times at which the caller woke up. The outputs are
deadlines and counts of missed steps. Except for `MonotonicClock`, nothing here reads a clock or
waits.
"""

import time
from collections.abc import Callable
from fractions import Fraction
from typing import Final, Protocol

__all__ = ["NS_PER_S", "Clock", "MonotonicClock", "Pace", "SampleTimes", "StepTime", "whole_steps"]

NS_PER_S: Final = 1_000_000_000
_LARGEST_DENOMINATOR: Final = 1_000_000_000
CATCH_UP_S: Final = 0.05
"""Maximum lateness at which steps still run in quick succession to catch up [s]. Scheduling
delays are shorter; a machine that is too slow soon exceeds it."""
LONGEST_SLEEP_NS: Final = 50_000_000
"""Maximum duration of an uninterruptible sleep, and thus the maximum delay of a stop [ns]."""


class Clock(Protocol):
    """A monotonic clock that can be waited on."""

    def now_ns(self) -> int:
        """Current time [ns], from an arbitrary origin."""

    def sleep_until_ns(self, deadline_ns: int, stopped: Callable[[], bool]) -> int:
        """Wait until `deadline_ns` or `stopped`, and return the time afterwards [ns]."""


class MonotonicClock:
    """CLOCK_MONOTONIC; waits in the kernel, without spinning."""

    def now_ns(self) -> int:
        """Current time [ns]."""
        return time.monotonic_ns()

    def sleep_until_ns(self, deadline_ns: int, stopped: Callable[[], bool]) -> int:
        """Wait until `deadline_ns` or `stopped`, and return the time afterwards [ns]."""
        now_ns = time.monotonic_ns()
        # A short sleep does not call `stopped`; the caller has just done so and will again.
        while (left_ns := deadline_ns - now_ns) > 0 and (
            left_ns <= LONGEST_SLEEP_NS or not stopped()
        ):
            # `time.sleep` calls clock_nanosleep with an absolute deadline on CLOCK_MONOTONIC.
            time.sleep(min(left_ns, LONGEST_SLEEP_NS) / NS_PER_S)
            now_ns = time.monotonic_ns()
        return now_ns


class Pace:
    """The absolute schedule of steps: step n is due n periods after the start of the schedule.

    Steps catch up if they are up to `CATCH_UP_S` late, so there is no drift. Beyond that, the
    schedule restarts at the current time and the lost time is counted.
    """

    def __init__(self, period_s: float) -> None:
        """Create a schedule; `start` starts it.

        Args:
            period_s: wall time between two steps [s], > 0.
        """
        self.period_ns: Final = period_s * NS_PER_S
        """Wall time between two steps [ns]."""
        self._catch_up_ns = CATCH_UP_S * NS_PER_S
        self._anchor_ns = 0
        self._count = 0
        self.overruns = 0
        """Number of restarts of the schedule since `start`."""
        self.lost_s = 0.0
        """Wall time of the skipped steps [s]."""

    def start(self, now_ns: int) -> None:
        """Start the schedule at `now_ns`; the first step is due one period later."""
        self._anchor_ns = now_ns
        self._count = 0
        self.overruns = 0
        self.lost_s = 0.0

    def next_deadline_ns(self, now_ns: int) -> int:
        """Return the time at which the next step is due [ns]; in the past if it is late."""
        self._count += 1
        deadline_ns = self._anchor_ns + round(self._count * self.period_ns)
        late_ns = now_ns - deadline_ns
        if late_ns <= self._catch_up_ns:
            return deadline_ns
        self.overruns += 1
        self.lost_s += late_ns / NS_PER_S
        self._anchor_ns = now_ns
        self._count = 0
        return now_ns


class StepTime:
    """Simulation time of a step, computed from the step count so that it does not drift."""

    def __init__(self, step_s: float) -> None:
        """Set the simulated time per step [s], > 0."""
        self._ns, self._per = (_meant(step_s) * NS_PER_S).as_integer_ratio()

    def ns(self, steps: int) -> int:
        """Simulation time of `steps` steps, rounded to the nearest ns."""
        if self._per == 1:  # most steps are a whole number of nanoseconds
            return steps * self._ns
        return (2 * steps * self._ns + self._per) // (2 * self._per)


class SampleTimes:
    """The steps after which samples are taken: those that reach a multiple of the period.

    If the period is not a whole number of steps, each multiple is rounded up individually to the
    next whole step, so the mean rate is exact. A period shorter than a step yields a sample after
    every step.
    """

    def __init__(self, *, period_s: float, step_s: float) -> None:
        """Start at step 0.

        Args:
            period_s: simulated time between two samples [s], > 0.
            step_s: simulated time of a step [s], > 0.
        """
        self._steps, self._per = (_meant(period_s) / _meant(step_s)).as_integer_ratio()
        self.next_step = 0
        """The step after which the next sample is taken; steps are numbered from 1."""
        self.pass_step(0)

    def pass_step(self, step: int) -> None:
        """Find the next sample after `step`."""
        if self._per == 1:  # most periods are a whole number of steps
            self.next_step = step - step % self._steps + self._steps
            return
        multiple = step * self._per // self._steps + 1
        reached = -(-multiple * self._steps // self._per)
        self.next_step = max(step + 1, reached)


def whole_steps(duration_s: float, step_s: float) -> int:
    """Number of steps to reach a duration [s]; both arguments > 0."""
    return -int(-_meant(duration_s) // _meant(step_s))


def _meant(seconds: float) -> Fraction:
    """Return the decimal or simple fraction that a float stands for: 0.001 is exactly 1/1000.

    With exact arithmetic, 0.002 is always twice 0.001; with floats, such relations may fail.
    """
    return Fraction(seconds).limit_denominator(_LARGEST_DENOMINATOR) or Fraction(seconds)
