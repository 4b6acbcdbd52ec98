"""Measure the rates of many topics at once, and the age of their messages when received.

One thread calls `Meter.turn` repeatedly to count received messages, by default every 5 ms. The
meters serve live tables and single measurements. Ages come from the stamps in the headers;
`DelayMeter` reads no clock.
"""

import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from math import sqrt
from operator import sub
from typing import Any, Final

from obk_cli.errors import CommandFailedError
from obk_cli.ros.field_path import HEADER, TIME, FieldsOf
from obk_cli.ros.participant import RosParticipant
from obk_cli.ros.raw_subscription import DropCounter, RawSubscription

__all__ = [
    "MOST_KEPT",
    "WATCH_TURN_S",
    "WATCH_WINDOW_S",
    "Delay",
    "DelayMeter",
    "Meter",
    "RosMeter",
    "TopicRate",
    "Watch",
    "is_of_other_clock",
    "stamp_getter",
    "watch_window_s",
]


MOST_KEPT: Final = 100_000
"""Maximum number of messages of one topic in a window: 10 s at 10 kHz."""
_NS: Final = 1e-9
_NEAR_ALL: Final = 0.99
OTHER_CLOCK_NS: Final = 10**16
"""About four months; larger differences mean that the stamp comes from another clock."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicRate:
    """The measured rate of a topic: statistics of the window, and counts since the start."""

    count: int
    """Messages since the start."""
    lost: int | None
    """Messages since the start that were published but not received; None if unknown."""
    seen: int
    """Messages in the window."""
    window_s: float
    """From the first to the last message in the window [s]."""
    rate_hz: float | None = None
    """Publication rate, including lost messages if known; None with fewer than two messages."""
    min_s: float | None = None
    """Shortest interval between two messages [s]."""
    max_s: float | None = None
    std_dev_s: float | None = None
    jitter_s: float | None = None
    """p99 deviation of intervals from their mean [s]."""
    bytes_per_s: float | None = None
    mean_bytes: float | None = None
    """Mean size of a serialized message [bytes]."""
    age_s: float | None = None
    """Time since the last message [s]; None if there was none."""


class Meter:
    """Counts the messages of one topic."""

    __slots__ = ("_drops", "_lost", "_received", "_sizes", "_window_ns", "publishers")

    def __init__(self, window_s: float) -> None:
        """Start without messages.

        Args:
            window_s: measurement window [s].
        """
        self._window_ns = round(window_s / _NS)
        self._received: deque[int] = deque(maxlen=MOST_KEPT)
        self._sizes: deque[int] = deque(maxlen=MOST_KEPT)
        self._lost: deque[int] = deque(maxlen=MOST_KEPT)
        self._drops = DropCounter()
        self.publishers = 0
        """Current number of publishers; set by the caller."""

    @property
    def count(self) -> int:
        """Messages since the start."""
        return self._drops.count

    def take(self, received_ns: int, size: int, sequence: int) -> None:
        """Count a message.

        Args:
            received_ns: time of receipt [ns since 1970].
            size: size of the serialized message [bytes].
            sequence: its sequence number from its publisher, from 1.
        """
        self._drops.take(sequence, self.publishers)
        self._received.append(received_ns)
        self._sizes.append(size)
        self._lost.append(self._drops.dropped)

    def rate(self, now_ns: int) -> TopicRate:
        """The rate measured so far.

        Args:
            now_ns: current time of the receiving clock [ns since 1970].
        """
        self._forget(now_ns - self._window_ns)
        times = self._received
        seen = len(times)
        lost = self._drops.dropped if self.publishers <= 1 else None
        age_s = (now_ns - times[-1]) * _NS if times else None
        without_rate = TopicRate(count=self.count, lost=lost, seen=seen, window_s=0.0, age_s=age_s)
        span_ns = times[-1] - times[0] if seen > 1 else 0
        if span_ns <= 0:
            return without_rate
        intervals = sorted(map(sub, islice(times, 1, None), times))
        mean_ns = span_ns / (seen - 1)
        off = sorted(abs(interval - mean_ns) for interval in intervals)
        variance = sum(one * one for one in off) / len(off)
        # The first message's bytes precede the window's first interval.
        come = sum(self._sizes) - self._sizes[0]
        published = seen - 1 + self._lost[-1] - self._lost[0]
        return replace(
            without_rate,
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
        # Keep the last message, so that its age is known.
        while len(self._received) > 1 and self._received[0] < before_ns:
            self._received.popleft()
            self._sizes.popleft()
            self._lost.popleft()


Watch = Callable[[int, bytes], None]
"""Called with a message's time of receipt [ns since 1970] and the serialized message."""

ReadClock = Callable[[int], int | None]
"""Converts wall-clock time [ns since 1970] to another clock; None if unknown."""


def _wall_ns(time_ns: int) -> int:
    return time_ns


TURN_S: Final = 0.005
"""Polling period of the subscriptions [s]."""
WATCH_TURN_S: Final = 0.02
"""Polling period while a whole stack is watched; it needs less processor time [s]."""
WATCH_WINDOW_S: Final = 2.0
"""Measurement window of a watched stack: a rate that is too low for this long is broken [s]."""
WATCH_PERIODS: Final = 5
"""Minimum number of periods in the window of a slow topic."""
REFRESH_S: Final = 0.1
"""Polling period of the publishers [s]."""

OLD_NS: Final = 500_000_000
"""Time after subscribing in which messages may count as old [ns]."""


def watch_window_s(period_s: float) -> float:
    """The window in which a watched topic with this period [s] is measured [s]."""
    return max(WATCH_WINDOW_S, WATCH_PERIODS * period_s)


class RosMeter:
    """Counts the messages of several topics."""

    def __init__(
        self, participant: RosParticipant, window_s: float, turn_s: float = TURN_S
    ) -> None:
        """Start without topics.

        Args:
            participant: the participant that subscribes.
            window_s: measurement window [s].
            turn_s: polling period [s]; the middleware records the times of messages.
        """
        self._participant = participant
        self._window_s = window_s
        self._turn_s = turn_s
        self._topics: dict[str, _Counted] = {}
        self._looked = time.monotonic()

    def add(
        self,
        name: str,
        msg_type: str,
        python_type: Any,
        watch: Watch | None = None,
        *,
        window_s: float | None = None,
        is_light: bool = False,
        is_first: bool = False,
        clock: ReadClock | None = None,
    ) -> None:
        """Start counting a topic's messages; has no effect if they are already counted.

        Args:
            name: full name.
            msg_type: full, `pkg/msg/Name`.
            python_type: the message's class.
            watch: called with each message.
            window_s: measurement window [s]; None: the default window.
            is_light: cause little load for publishers, even if messages may be missed.
            is_first: take its messages before those of other topics in each turn.
            clock: time base of its statistics; None: wall time.
        """
        if name not in self._topics:
            raw = self._participant.subscribe(name, msg_type, python_type, is_light=is_light)
            counted = _Counted(raw, Meter(window_s or self._window_s), watch, clock or _wall_ns)
            others = self._topics
            self._topics = {name: counted, **others} if is_first else {**others, name: counted}

    def drop(self, name: str) -> None:
        """Stop counting a topic's messages."""
        self._topics.pop(name).raw.close()

    def close(self) -> None:
        """Stop counting all topics."""
        for name in tuple(self._topics):
            self.drop(name)

    def turn(self) -> None:
        """Count received messages, then sleep until the turn is over."""
        start = time.monotonic()
        self._take(start)
        time.sleep(max(0.0, self._turn_s - (time.monotonic() - start)))

    def rates(self) -> Mapping[str, TopicRate]:
        """The rates measured so far, by topic."""
        # The caller may have slept or waited for others, so count new messages first.
        self._take(time.monotonic())
        now_ns = time.time_ns()
        return {
            name: topic.meter.rate(topic.clock(now_ns) or 0) for name, topic in self._topics.items()
        }

    def _take(self, start: float) -> None:
        if start - self._looked > REFRESH_S:
            self._looked = start
            for topic in self._topics.values():
                topic.raw.refresh()
        for topic in self._topics.values():
            meter, watch = topic.meter, topic.watch
            meter.publishers = topic.raw.publishers
            take = meter.take
            for data, info in topic.raw.take():
                received_ns = info["received_timestamp"]
                if not topic.is_fresh and topic.is_old(received_ns, info["source_timestamp"]):
                    continue
                if (time_ns := topic.clock(received_ns)) is not None:
                    take(time_ns, len(data), info["publication_sequence_number"])
                if watch is not None:
                    watch(received_ns, data)


class _Counted:
    """A topic whose messages are counted, except those that its publisher had stored."""

    __slots__ = ("_begun_ns", "_first_ns", "clock", "is_fresh", "meter", "raw", "watch")

    def __init__(
        self, raw: RawSubscription, meter: Meter, watch: Watch | None, clock: ReadClock
    ) -> None:
        self.raw = raw
        self.meter = meter
        self.watch = watch
        self.clock = clock
        self.is_fresh = False
        """Whether a message that was published after the subscription has arrived."""
        self._begun_ns = time.time_ns()
        self._first_ns: int | None = None

    def is_old(self, received_ns: int, published_ns: int) -> bool:
        """Whether it was published before this subscription existed.

        Such messages arrive all at once, as if the rate were higher. A publisher's clock may be
        behind, so this check ends soon after the first message.
        """
        if self._first_ns is None:
            self._first_ns = received_ns
        is_new = published_ns >= self._begun_ns
        self.is_fresh = is_new or received_ns - self._first_ns > OLD_NS
        return not self.is_fresh


def is_of_other_clock(received_ns: int, stamp_ns: int) -> bool:
    """Whether a stamp [ns] does not come from the wall clock."""
    return abs(received_ns - stamp_ns) > OTHER_CLOCK_NS


@dataclass(frozen=True, slots=True, kw_only=True)
class Delay:
    """The measured delay of a topic within the window."""

    seen: int
    """Messages."""
    is_simulated: bool
    """Whether the delays are in simulated time, like the stamps."""
    is_relative: bool
    """Whether the stamps' clock is unknown; the fastest message's delay then counts as 0."""
    pace: float
    """Seconds of the stamps' clock per second of wall time; 1 for the wall clock."""
    mean_s: float
    min_s: float
    max_s: float
    std_dev_s: float


class DelayMeter:
    """Keeps the delays of the latest messages."""

    def __init__(self, window: int) -> None:
        """Start without messages.

        Args:
            window: number of messages to keep.
        """
        self._taken: deque[tuple[int, int]] = deque(maxlen=window)
        self._simulated: deque[int] = deque(maxlen=window)
        """Delays in simulated time [ns]."""
        self.unstamped = 0
        """Messages with a zero stamp, which was never set."""

    def take(self, received_ns: int, stamp_ns: int, simulated_ns: int | None = None) -> None:
        """Count a message.

        Args:
            received_ns: time of receipt [ns since 1970].
            stamp_ns: the stamp in its header [ns].
            simulated_ns: simulated time of receipt [ns]; None if unknown.
        """
        if not stamp_ns:
            self.unstamped += 1
            return
        self._taken.append((received_ns, stamp_ns))
        if simulated_ns is not None and is_of_other_clock(received_ns, stamp_ns):
            # `/clock` may arrive after the message of the same step.
            self._simulated.append(max(0, simulated_ns - stamp_ns))

    def delay(self) -> Delay | None:
        """The measured delay; None without stamped messages."""
        if not self._taken:
            return None
        delays: list[float] = [received - stamp for received, stamp in self._taken]
        is_other = abs(min(delays)) > OTHER_CLOCK_NS
        is_simulated = is_other and bool(self._simulated)
        pace = self._pace() if is_other else 1.0
        if is_simulated:
            delays = list(self._simulated)
        elif is_other:
            delays = self._above_the_quickest(pace)
        mean = sum(delays) / len(delays)
        variance = sum((one - mean) ** 2 for one in delays) / len(delays)
        return Delay(
            seen=len(delays),
            is_simulated=is_simulated,
            is_relative=is_other and not is_simulated,
            pace=pace,
            mean_s=mean * _NS,
            min_s=min(delays) * _NS,
            max_s=max(delays) * _NS,
            std_dev_s=sqrt(variance) * _NS,
        )

    def _pace(self) -> float:
        """The pace from the first message to the last."""
        (first_ns, first_stamp_ns), (last_ns, last_stamp_ns) = self._taken[0], self._taken[-1]
        passed_ns, stamped_ns = last_ns - first_ns, last_stamp_ns - first_stamp_ns
        return stamped_ns / passed_ns if passed_ns > 0 and stamped_ns > 0 else 1.0

    def _above_the_quickest(self, pace: float) -> list[float]:
        """Delays relative to the fastest message, in wall time [ns]."""
        first_ns, first_stamp_ns = self._taken[0]
        delays = [
            received - first_ns - (stamp - first_stamp_ns) / pace for received, stamp in self._taken
        ]
        least = min(delays)
        return [one - least for one in delays]


NS: Final = 1_000_000_000


def stamp_getter(msg_type: str, fields_of: FieldsOf) -> Callable[[Any], int]:
    """A function that returns the stamp of a message [ns].

    Args:
        msg_type: `pkg/Name`.
        fields_of: looks up the fields of types.

    Raises:
        CommandFailedError: such messages have no stamp.
    """
    fields = fields_of(msg_type)
    header = next((name for name, kind in fields.items() if kind == HEADER), None)
    if header is not None:
        return lambda message: _ns(getattr(message, header).stamp)
    time = next((name for name, kind in fields.items() if kind == TIME), None)
    if time is None:
        raise CommandFailedError(
            f"{msg_type} has no header and no stamp, so the age of a message is unknown"
        )
    return lambda message: _ns(getattr(message, time))


def _ns(stamp: Any) -> int:
    return int(stamp.sec) * NS + int(stamp.nanosec)
