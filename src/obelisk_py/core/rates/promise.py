"""A rate that the config promises, and whether it is kept: read once a second.

In: a counter that somebody feeds, the clock that the promise is about. Out: a `Rate` at each read.
Only too slow is off: what keeps to a schedule cannot be ahead of it, and a tick that comes on time
after a late one is no fault.
"""

from collections.abc import Callable
from typing import Final

from obelisk_py.core.rates.counter import TickCounter, late_ns_of
from obelisk_spec.rates import TOLERANCE, Rate, Standing

__all__ = ["Promise"]

NS_PER_S: Final = 1_000_000_000
NS_PER_US: Final = 1000
BROKEN_READS: Final = 2
"""So many in a row, a second each."""
FORGIVEN_READS: Final = 1
"""After the start, when everything else starts too."""
SHARES: Final = (0.5, 0.99, 1.0)


class Promise:
    """One promised rate."""

    def __init__(
        self, *, name: str, wanted_hz: float, counter: TickCounter, clock: Callable[[], int | None]
    ) -> None:
        """Make a promise; it holds from `begin` on.

        Args:
            name: as in `Rate`.
            wanted_hz: ticks per second of `clock` [Hz].
            counter: counts the ticks, by `clock`.
            clock: the present time [ns]; None while nothing is promised.
        """
        self.name = name
        self._wanted_hz = wanted_hz
        self._counter = counter
        self._clock = clock
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
        self._off_reads = -FORGIVEN_READS

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
        if self._off_reads >= BROKEN_READS:
            return "broken"
        return "off" if self._off_reads > 0 else "kept"

    def _measure(self, newest_ns: int, ticks: int) -> None:
        now_ns, since_ns = self._clock(), self._since_ns
        new = ticks - self._last_tick
        self._last_tick = ticks
        last_ns = newest_ns if new else now_ns
        if now_ns is None or since_ns is None or last_ns is None or last_ns <= since_ns:
            # Nothing was promised, or simulated time stood still or went back.
            self._since_ns = now_ns
            self._off_reads = -FORGIVEN_READS
            return
        if new:
            # From tick to tick: a second holds now one more and now one less.
            self._measured_hz = new * NS_PER_S / max(1, newest_ns - since_ns)
            self._since_ns = newest_ns
        # What it were if one more tick came right now.
        most_hz = (new + 1) * NS_PER_S / max(1, now_ns - since_ns)
        self._measured_hz = min(self._measured_hz, most_hz)
        is_off = self._measured_hz < (1 - TOLERANCE) * self._wanted_hz
        self._off_reads = self._off_reads + 1 if is_off else 0
