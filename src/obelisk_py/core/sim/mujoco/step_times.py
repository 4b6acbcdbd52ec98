"""Compute when a step is due, and which steps a sample follows, for a given clock.

In: a clock, a period, the times at which the caller woke. Out: deadlines, and counts of what was
missed. Never reads a clock of its own and never waits, `MonotonicClock` aside.
"""

import time
from collections.abc import Callable
from fractions import Fraction
from typing import Final, Protocol

__all__ = ["Clock", "MonotonicClock", "Pace", "SampleTimes", "StepTime", "whole_steps"]

NS_PER_S: Final = 1_000_000_000
_LARGEST_DENOMINATOR: Final = 1_000_000_000
CATCH_UP_S: Final = 0.05
"""Lateness that is made up for by steps in quick succession [s]; the scheduler's hiccups are
shorter, a machine that is too slow is soon beyond it."""
LONGEST_SLEEP_NS: Final = 50_000_000
"""A sleep cannot be interrupted: in this time a slow simulation still answers a stop [ns]."""


class Clock(Protocol):
    """A clock that never jumps, and a wait on it."""

    def now_ns(self) -> int:
        """Now [ns], from an origin of the clock's own."""

    def sleep_until_ns(self, deadline_ns: int, stopped: Callable[[], bool]) -> int:
        """Wait for `deadline_ns` or for `stopped`; the time at which it returned [ns]."""


class MonotonicClock:
    """CLOCK_MONOTONIC; waits in the kernel, without spinning."""

    def now_ns(self) -> int:
        """Now [ns]."""
        return time.monotonic_ns()

    def sleep_until_ns(self, deadline_ns: int, stopped: Callable[[], bool]) -> int:
        """Wait for `deadline_ns` or for `stopped`; the time at which it returned [ns]."""
        now_ns = time.monotonic_ns()
        # A short sleep asks nothing: the caller has just asked, and will again.
        while (left_ns := deadline_ns - now_ns) > 0 and (
            left_ns <= LONGEST_SLEEP_NS or not stopped()
        ):
            # Python's sleep is clock_nanosleep to an absolute time of CLOCK_MONOTONIC.
            time.sleep(min(left_ns, LONGEST_SLEEP_NS) / NS_PER_S)
            now_ns = time.monotonic_ns()
        return now_ns


class Pace:
    """The absolute schedule of steps: step n is due n periods after the anchor.

    Lateness of up to `CATCH_UP_S` is made up for, so there is no drift. Beyond that the schedule
    is anchored again at the present and the lost time is counted: no racing.
    """

    def __init__(self, period_s: float) -> None:
        """Make a schedule; `start` sets its anchor.

        Args:
            period_s: wall time between two steps [s], > 0.
        """
        self.period_ns: Final = period_s * NS_PER_S
        """Wall time between two steps [ns]."""
        self._catch_up_ns = CATCH_UP_S * NS_PER_S
        self._anchor_ns = 0
        self._count = 0
        self.overruns = 0
        """Number of times the schedule was anchored again since `start`."""
        self.lost_s = 0.0
        """Wall time of the skipped steps [s]."""

    def start(self, now_ns: int) -> None:
        """Anchor the schedule at `now_ns`; the first step is due one period later."""
        self._anchor_ns = now_ns
        self._count = 0
        self.overruns = 0
        self.lost_s = 0.0

    def next_deadline_ns(self, now_ns: int) -> int:
        """When the next step is due [ns]; in the past where it is late."""
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
    """The simulation time of a step, by counting: nothing adds up, so nothing drifts."""

    def __init__(self, step_s: float) -> None:
        """Take the step's simulation time [s], > 0."""
        self._ns, self._per = (_meant(step_s) * NS_PER_S).as_integer_ratio()

    def ns(self, steps: int) -> int:
        """Simulation time of `steps` steps [ns], to the nearest."""
        return (2 * steps * self._ns + self._per) // (2 * self._per)


class SampleTimes:
    """The steps after which something is sampled: those that reach a multiple of its period.

    A period that is no whole number of steps keeps its mean rate: each multiple is rounded up to
    a step for itself. A period shorter than the step is sampled at every step.
    """

    def __init__(self, *, period_s: float, step_s: float) -> None:
        """Start at step 0.

        Args:
            period_s: simulation time between two samples [s], > 0.
            step_s: simulation time of a step [s], > 0.
        """
        self._steps, self._per = (_meant(period_s) / _meant(step_s)).as_integer_ratio()
        self.next_step = 0
        """The step after which the next sample is taken; steps count from 1."""
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
    """How many steps it takes to reach a duration [s]; both > 0."""
    return -int(-_meant(duration_s) // _meant(step_s))


def _meant(seconds: float) -> Fraction:
    """The number that a float stands for: 0.001 is a thousandth, 1 / 3 a third.

    In exact arithmetic 0.002 is then twice 0.001, which the two floats only are by luck.
    """
    return Fraction(seconds).limit_denominator(_LARGEST_DENOMINATOR) or Fraction(seconds)
