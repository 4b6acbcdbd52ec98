"""How often the messages of a topic come: counted one by one, judged when somebody asks.

In: when a message was received, its size, its publisher's number. Out: rate, intervals, losses,
bandwidth over a window. Counting one message takes well under a microsecond and a fixed amount of
memory; it looks into no message and at no clock.
"""

from collections import deque
from dataclasses import dataclass, replace
from itertools import islice
from math import sqrt
from operator import sub
from typing import Final

from obk_cli.ros.raw_subscription import DropCounter

__all__ = ["MOST_KEPT", "Meter", "TopicRate"]

MOST_KEPT: Final = 100_000
"""Messages of one topic that a window may hold: 10 s at 10 kHz."""
_NS: Final = 1e-9
_NEAR_ALL: Final = 0.99


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicRate:
    """What was measured of one topic; the figures are of the window, the counts of all time."""

    count: int
    """Messages since the beginning."""
    lost: int | None
    """Messages since the beginning that were published and did not come; None: not known."""
    seen: int
    """Messages in the window."""
    window_s: float
    """From the first to the last message in the window [s]."""
    rate_hz: float | None = None
    """At which they are published, lost ones among them where known; None: fewer than two came."""
    min_s: float | None = None
    """Shortest time between two messages [s]."""
    max_s: float | None = None
    std_dev_s: float | None = None
    jitter_s: float | None = None
    """By which 99 % of the times between two messages are at most off their mean [s]."""
    bytes_per_s: float | None = None
    mean_bytes: float | None = None
    """Of a message as it is sent [bytes]."""
    age_s: float | None = None
    """Since the last message [s]; None: there was none."""


class Meter:
    """Counts the messages of one topic."""

    __slots__ = ("_lost", "_received", "_sizes", "_tally", "_window_ns", "bytes", "publishers")

    def __init__(self, window_s: float) -> None:
        """Begin with none.

        Args:
            window_s: how far back figures go [s].
        """
        self._window_ns = round(window_s / _NS)
        self._received: deque[int] = deque(maxlen=MOST_KEPT)
        self._sizes: deque[int] = deque(maxlen=MOST_KEPT)
        self._lost: deque[int] = deque(maxlen=MOST_KEPT)
        self._tally = DropCounter()
        self.publishers = 0
        """How many there are now; set by whoever knows."""
        self.bytes = 0
        """Of all messages."""

    @property
    def count(self) -> int:
        """Messages since the beginning."""
        return self._tally.count

    def take(self, received_ns: int, size: int, sequence: int) -> None:
        """Count a message.

        Args:
            received_ns: when it came [ns since 1970].
            size: of the serialized message [bytes].
            sequence: its number among those of its publisher, from 1.
        """
        self._tally.take(sequence, self.publishers)
        self._received.append(received_ns)
        self._sizes.append(size)
        self._lost.append(self._tally.dropped)
        self.bytes += size

    def rate(self, now_ns: int) -> TopicRate:
        """What was measured by now.

        Args:
            now_ns: the clock by which messages were received [ns since 1970].
        """
        self._forget(now_ns - self._window_ns)
        times = self._received
        seen = len(times)
        lost = self._tally.dropped if self.publishers <= 1 else None
        age_s = (now_ns - times[-1]) * _NS if times else None
        told = TopicRate(count=self.count, lost=lost, seen=seen, window_s=0.0, age_s=age_s)
        span_ns = times[-1] - times[0] if seen > 1 else 0
        if span_ns <= 0:
            return told
        intervals = sorted(map(sub, islice(times, 1, None), times))
        mean_ns = span_ns / (seen - 1)
        off = sorted(abs(interval - mean_ns) for interval in intervals)
        variance = sum(one * one for one in off) / len(off)
        # The first message's bytes came before the window's first interval.
        come = sum(self._sizes) - self._sizes[0]
        published = seen - 1 + self._lost[-1] - self._lost[0]
        return replace(
            told,
            window_s=span_ns * _NS,
            rate_hz=published / (span_ns * _NS),
            min_s=intervals[0] * _NS,
            max_s=intervals[-1] * _NS,
            std_dev_s=sqrt(variance) * _NS,
            jitter_s=off[min(len(off) - 1, int(_NEAR_ALL * len(off)))] * _NS,
            bytes_per_s=come / (span_ns * _NS),
            mean_bytes=come / (seen - 1),
        )

    def _forget(self, before_ns: int) -> None:
        # The last one stays, so that its age is known.
        while len(self._received) > 1 and self._received[0] < before_ns:
            self._received.popleft()
            self._sizes.popleft()
            self._lost.popleft()
