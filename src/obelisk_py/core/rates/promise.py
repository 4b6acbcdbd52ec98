"""A rate that the config promises, and whether it is kept: read once a second.

In: a counter that somebody feeds, the clock that the promise is about. Out: a `Rate` at each read.
Only too slow is off: what keeps to a schedule cannot be ahead of it, and a tick that comes on time
after a late one is no fault.
"""

import time
from collections.abc import Callable
from typing import Final

from obelisk_py.core.rates.counter import TickCounter, late_ns_of
from obelisk_spec.runtime_protocol import REPORT_PERIOD_S, TOLERANCE, Rate, Standing

__all__ = ["Promise"]

NS_PER_S: Final = 1_000_000_000
NS_PER_US: Final = 1000
BROKEN_S: Final = 2.0
"""For which a rate is off without a break until it is broken [s]."""
EARLY_S: Final = 0.1
"""By which a read may come early, because the one before it was late [s]."""
SHARES: Final = (0.5, 0.99, 1.0)


class Promise:
    """One promised rate."""

    def __init__(
        self,
        *,
        name: str,
        wanted_hz: float,
        counter: TickCounter,
        clock: Callable[[], int | None],
        steady_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Make a promise; it holds from `begin` on.

        Args:
            name: as in `Rate`.
            wanted_hz: ticks per second of `clock` [Hz].
            counter: counts the ticks, by `clock`.
            clock: the present time [ns]; None while nothing is promised.
            steady_s: the time by which it is read, whatever `clock` is [s].
        """
        self.name = name
        self._wanted_hz = wanted_hz
        self._counter = counter
        self._clock = clock
        self._steady_s = steady_s
        self.begin()

    def begin(self) -> None:
        """The promise holds from now on; what was counted before is forgotten."""
        counter = self._counter
        self._first_tick = self._last_tick = counter.ticks
        self._first_overrun = counter.overruns
        self._buckets = counter.buckets.copy()
        self._since_ns = self._clock()
        """The newest tick that the last read knew, or the beginning."""
        self._measured_hz = self._wanted_hz
        self._read_s = self._steady_s()
        self._off_s: float | None = None
        """For how long it has been off [s]; None: the next read is forgiven, for everything else
        starts then too."""

    def read(self) -> Rate:
        """How the promise is kept."""
        counter = self._counter
        buckets = counter.buckets.copy()
        newest_ns, ticks = counter.newest_ns, counter.ticks
        self._measure(newest_ns, ticks)
        of_this_read = [now - before for now, before in zip(buckets, self._buckets, strict=True)]
        self._buckets = buckets
        p50_us, p99_us, max_us = (ns / NS_PER_US for ns in late_ns_of(of_this_read, SHARES))
        return Rate(
            name=self.name,
            wanted_hz=self._wanted_hz,
            measured_hz=self._measured_hz,
            ticks=ticks - self._first_tick,
            overruns=counter.overruns - self._first_overrun,
            late_p50_us=p50_us,
            late_p99_us=p99_us,
            late_max_us=max_us,
            standing=self._standing,
        )

    @property
    def _standing(self) -> Standing:
        if not self._off_s:
            return "kept"
        return "broken" if self._off_s >= BROKEN_S - EARLY_S else "off"

    def _measure(self, newest_ns: int, ticks: int) -> None:
        now_ns, since_ns = self._clock(), self._since_ns
        new = ticks - self._last_tick
        self._last_tick = ticks
        read_s, self._read_s = self._read_s, self._steady_s()
        last_ns = newest_ns if new else now_ns
        if now_ns is None or since_ns is None or last_ns is None or last_ns <= since_ns:
            # Nothing was promised, or simulated time stood still or went back.
            self._since_ns = now_ns
            self._off_s = None
            self._measured_hz = self._wanted_hz
            return
        if new:
            # From tick to tick: a second holds now one more and now one less.
            self._measured_hz = new * NS_PER_S / max(1, newest_ns - since_ns)
            self._since_ns = newest_ns
        # What it were if one more tick came right now.
        most_hz = (new + 1) * NS_PER_S / max(1, now_ns - since_ns)
        self._measured_hz = min(self._measured_hz, most_hz)
        is_off = self._measured_hz < (1 - TOLERANCE) * self._wanted_hz
        # A read that is late tells of no more than the second before it.
        shown_s = min(self._read_s - read_s, REPORT_PERIOD_S)
        self._off_s = 0.0 if self._off_s is None or not is_off else self._off_s + shown_s
