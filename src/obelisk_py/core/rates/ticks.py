"""What feeds the counters: a timer's calls, and the samples of a sensor group.

An rcl timer knows its schedule, whatever executor calls it and whatever clock it is on: after its
call it tells when it is due next, which is one period after the time at which it was due now.
"""

import functools
import inspect
from collections.abc import Callable
from typing import Any

from rclpy.timer import Timer

from obelisk_py.core.rates.counter import TickCounter

__all__ = ["SampleTicks", "TimerTicks"]


class TimerTicks:
    """Counts the calls of one timer."""

    def __init__(self, counter: TickCounter, *, period_ns: int, clock: Callable[[], int]) -> None:
        """Make a count.

        Args:
            counter: takes the ticks.
            period_ns: the timer's [ns].
            clock: the present time of the timer's clock [ns].
        """
        self._counter = counter
        self._period_ns = period_ns
        self._skips_above_ns = period_ns + period_ns // 2
        self._clock = clock
        self._until_due: Callable[[], int | None] = lambda: None
        self._due_ns: int | None = None
        """When the next tick is due; None at the start of the timer."""

    def counted(self, callback: Callable[[], Any]) -> Callable[[], Any]:
        """The same callback of a timer, counted."""

        @functools.wraps(callback)
        async def wait() -> Any:
            self.tick()
            return await callback()

        @functools.wraps(callback)
        def call() -> Any:
            self.tick()
            return callback()

        return wait if inspect.iscoroutinefunction(callback) else call

    def follow(self, timer: Timer) -> None:
        """The timer whose callback is counted."""
        self._until_due = timer.handle.time_until_next_call

    def begin(self) -> None:
        """The timer starts anew."""
        self._due_ns = None

    def tick(self) -> None:
        """The timer was called."""
        now_ns = self._clock()
        left_ns = self._until_due()
        if left_ns is None:  # stopped meanwhile
            return
        next_ns = now_ns + left_ns
        due_ns = self._due_ns
        self._due_ns = next_ns
        late_ns, skipped = self._period_ns - left_ns, 0
        if due_ns is not None and next_ns - due_ns > self._skips_above_ns:
            skipped = round((next_ns - due_ns) / self._period_ns) - 1
            late_ns += skipped * self._period_ns
        self._counter.tick(now_ns, late_ns, skipped)


class SampleTicks:
    """Counts samples in simulation time; they are due when they come, so none is late.

    How late their steps are by wall time is counted of the steps.
    """

    def __init__(self, counter: TickCounter, *, period_ns: int, clock: Callable[[], int]) -> None:
        """Make a count.

        Args:
            counter: takes the samples.
            period_ns: simulation time between two of them [ns].
            clock: the present simulation time [ns].
        """
        self._counter = counter
        self._period_ns = period_ns
        self._skips_above_ns = period_ns + period_ns // 2
        self._clock = clock

    def tick(self) -> None:
        """A sample was taken, or was dropped as the config wants it."""
        now_ns = self._clock()
        skipped = 0
        if self._counter.ticks:
            passed_ns = now_ns - self._counter.newest_ns
            if passed_ns > self._skips_above_ns:
                skipped = round(passed_ns / self._period_ns) - 1
        self._counter.tick(now_ns, 0, skipped)
