"""Counts ticks and how late they were, in memory that does not grow.

Lateness lies in buckets, 16 for each factor of two: what is read out is at most 1/16 too much, and
never too little. Anything below a microsecond reads as 0. Reads no clock.
"""

from collections.abc import Sequence
from typing import Final

__all__ = ["TickCounter", "late_ns_of"]

_SUB_BITS: Final = 4
_SUB_BUCKETS: Final = 1 << _SUB_BITS
_SHORTEST_NS: Final = 1 << 10
_LONGEST_NS: Final = (1 << 37) - 1
"""More than two minutes."""


def _bucket(late_ns: int) -> int:
    shift = late_ns.bit_length() - _SUB_BITS - 1
    return (shift << _SUB_BITS) + (late_ns >> shift)


_FIRST: Final = _bucket(_SHORTEST_NS)
_BUCKETS: Final = _bucket(_LONGEST_NS) + 1


class TickCounter:
    """Ticks and their lateness; read by one thread while another one counts."""

    __slots__ = ("buckets", "newest_ns", "overruns", "ticks")

    def __init__(self) -> None:
        """Begin at no tick."""
        self.ticks = 0
        self.overruns = 0
        """Ticks that were left out, or came as one with the next."""
        self.newest_ns = 0
        """When the newest tick came [ns], on the clock of whoever counts."""
        self.buckets = [0] * _BUCKETS
        """Ticks by lateness; they only ever grow, so that a reader need not stop the counting."""

    def tick(self, now_ns: int, late_ns: int, skipped: int = 0) -> None:
        """Count a tick.

        Args:
            now_ns: when it came [ns].
            late_ns: how much later than it was due [ns].
            skipped: ticks that were due since the one before it and did not come.
        """
        if late_ns < _SHORTEST_NS:
            late_ns = _SHORTEST_NS
        elif late_ns > _LONGEST_NS:
            late_ns = _LONGEST_NS
        shift = late_ns.bit_length() - _SUB_BITS - 1  # `_bucket`, without the call
        # No call from here on: between calls CPython lets no other thread in, so that who reads
        # these one after another never sees half a tick.
        self.buckets[(shift << _SUB_BITS) + (late_ns >> shift)] += 1
        self.ticks += 1
        self.overruns += skipped
        self.newest_ns = now_ns


def late_ns_of(buckets: Sequence[int], shares: Sequence[float]) -> tuple[float, ...]:
    """For each share (0 to 1, ascending): the lateness [ns] that so many ticks do not exceed.

    All 0 where there is no tick.
    """
    total = sum(buckets)
    found: list[float] = []
    seen = 0
    for place, count in enumerate(buckets):
        seen += count
        while count and len(found) < len(shares) and seen >= shares[len(found)] * total:
            found.append(_upper_edge_ns(place))
    return (*found, *(0.0,) * (len(shares) - len(found)))


def _upper_edge_ns(place: int) -> float:
    if place == _FIRST:
        return 0.0
    shift = (place >> _SUB_BITS) - 1
    return float(((place % _SUB_BUCKETS + _SUB_BUCKETS + 1) << shift) - 1)
