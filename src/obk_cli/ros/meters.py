"""Measure the rates of many topics at once, and how old their messages are when they are received.

One thread calls `Meter.turn` again and again: what has arrived is counted, every 5 ms unless set
otherwise. For live tables and for single measurements alike. Ages come from the stamps in the
headers; `DelayMeter` reads no clock.
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
from obk_cli.ros.field_path import FieldsOf
from obk_cli.ros.participant import RosParticipant
from obk_cli.ros.raw_subscription import DropCounter, RawSubscription

__all__ = [
    "MOST_KEPT",
    "Delay",
    "DelayMeter",
    "Meter",
    "RosMeter",
    "TopicRate",
    "Watch",
    "is_of_other_clock",
    "stamp_getter",
]


MOST_KEPT: Final = 100_000
"""Messages of one topic that a window may hold: 10 s at 10 kHz."""
_NS: Final = 1e-9
_NEAR_ALL: Final = 0.99
OTHER_CLOCK_NS: Final = 10**16
"""About four months; farther apart are only stamps of another clock, such as a simulator's."""


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

    __slots__ = ("_drops", "_lost", "_received", "_sizes", "_window_ns", "bytes", "publishers")

    def __init__(self, window_s: float) -> None:
        """Begin with none.

        Args:
            window_s: how far back figures go [s].
        """
        self._window_ns = round(window_s / _NS)
        self._received: deque[int] = deque(maxlen=MOST_KEPT)
        self._sizes: deque[int] = deque(maxlen=MOST_KEPT)
        self._lost: deque[int] = deque(maxlen=MOST_KEPT)
        self._drops = DropCounter()
        self.publishers = 0
        """The number of publishers now; set by the caller."""
        self.bytes = 0
        """Of all messages."""

    @property
    def count(self) -> int:
        """Messages since the beginning."""
        return self._drops.count

    def take(self, received_ns: int, size: int, sequence: int) -> None:
        """Count a message.

        Args:
            received_ns: when it came [ns since 1970].
            size: of the serialized message [bytes].
            sequence: its number among those of its publisher, from 1.
        """
        self._drops.take(sequence, self.publishers)
        self._received.append(received_ns)
        self._sizes.append(size)
        self._lost.append(self._drops.dropped)
        self.bytes += size

    def rate(self, now_ns: int) -> TopicRate:
        """What was measured by now.

        Args:
            now_ns: the clock by which messages were received [ns since 1970].
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
        # The first message's bytes came before the window's first interval.
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
        # The last one stays, so that its age is known.
        while len(self._received) > 1 and self._received[0] < before_ns:
            self._received.popleft()
            self._sizes.popleft()
            self._lost.popleft()


Watch = Callable[[int, bytes], None]
"""Takes when a message was received [ns since 1970], and the message as it was sent."""

ReadClock = Callable[[int], int | None]
"""Converts a time of the wall clock [ns since 1970] into that of another one; None: not known."""


def _wall_ns(time_ns: int) -> int:
    return time_ns


TURN_S: Final = 0.005
"""Between two looks at the subscriptions [s]."""
REFRESH_S: Final = 0.1
"""Between two looks at the publishers [s]."""

OLD_NS: Final = 500_000_000
"""For which messages may be taken for old ones [ns]."""


class RosMeter:
    """Counts the messages of topics."""

    def __init__(
        self, participant: RosParticipant, window_s: float, turn_s: float = TURN_S
    ) -> None:
        """Begin with no topic.

        Args:
            participant: the participant that subscribes.
            window_s: how far back figures go [s].
            turn_s: between two checks for messages [s]; the middleware measures their times.
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
        """Count a topic's messages from now on; one that is counted already goes on.

        Args:
            name: full.
            msg_type: full, `pkg/msg/Name`.
            python_type: the message's class.
            watch: is shown each message.
            window_s: how far back its figures go [s]; None: as those of others.
            is_light: cost its publishers little, and miss a message rather.
            is_first: take its messages before those of the other topics in each turn.
            clock: the time in which its figures are; None: wall time.
        """
        if name not in self._topics:
            raw = self._participant.subscribe(name, msg_type, python_type, is_light=is_light)
            counted = _Counted(raw, Meter(window_s or self._window_s), watch, clock or _wall_ns)
            others = self._topics
            self._topics = {name: counted, **others} if is_first else {**others, name: counted}

    def drop(self, name: str) -> None:
        """Count a topic's messages no more."""
        self._topics.pop(name).raw.close()

    def close(self) -> None:
        """Count no topic any more."""
        for name in tuple(self._topics):
            self.drop(name)

    def turn(self) -> None:
        """Count what has come, then rest until the turn is over."""
        begin = time.monotonic()
        self._take(begin)
        time.sleep(max(0.0, self._turn_s - (time.monotonic() - begin)))

    def rates(self) -> Mapping[str, TopicRate]:
        """What was measured by now, by topic."""
        # The caller may have slept or waited for others: count what has come since.
        self._take(time.monotonic())
        now_ns = time.time_ns()
        return {
            name: topic.meter.rate(topic.clock(now_ns) or 0) for name, topic in self._topics.items()
        }

    def _take(self, begin: float) -> None:
        if begin - self._looked > REFRESH_S:
            self._looked = begin
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
    """A topic whose messages are counted, but for those that its publisher had kept."""

    __slots__ = ("_begun_ns", "_first_ns", "clock", "is_fresh", "meter", "raw", "watch")

    def __init__(
        self, raw: RawSubscription, meter: Meter, watch: Watch | None, clock: ReadClock
    ) -> None:
        self.raw = raw
        self.meter = meter
        self.watch = watch
        self.clock = clock
        self.is_fresh = False
        """Whether a message has come that was published since."""
        self._begun_ns = time.time_ns()
        self._first_ns: int | None = None

    def is_old(self, received_ns: int, published_ns: int) -> bool:
        """Whether it was published before this subscription existed.

        Such messages come all at once, as if the rate were higher. A publisher's clock may be
        behind: so this ends soon after the first message.
        """
        if self._first_ns is None:
            self._first_ns = received_ns
        is_new = published_ns >= self._begun_ns
        self.is_fresh = is_new or received_ns - self._first_ns > OLD_NS
        return not self.is_fresh


def is_of_other_clock(received_ns: int, stamp_ns: int) -> bool:
    """Whether a stamp [ns] is not of the wall clock by which its message was received."""
    return abs(received_ns - stamp_ns) > OTHER_CLOCK_NS


@dataclass(frozen=True, slots=True, kw_only=True)
class Delay:
    """What was measured of one topic within the window."""

    seen: int
    """Messages."""
    is_simulated: bool
    """Whether the delays are in simulated time, as the stamps are."""
    is_relative: bool
    """Whether the stamps' clock is unknown; then the quickest message's delay counts as 0."""
    pace: float
    """Seconds of the stamps' clock in one of the wall's; 1 where it is the wall's."""
    mean_s: float
    min_s: float
    max_s: float
    std_dev_s: float


class DelayMeter:
    """Keeps the delays of the newest messages."""

    def __init__(self, window: int) -> None:
        """Begin with none.

        Args:
            window: how many messages are kept.
        """
        self._taken: deque[tuple[int, int]] = deque(maxlen=window)
        self._simulated: deque[int] = deque(maxlen=window)
        """Delays in simulated time [ns]."""
        self.unstamped = 0
        """Messages whose stamp is zero: it was never set."""

    def take(self, received_ns: int, stamp_ns: int, simulated_ns: int | None = None) -> None:
        """Count a message.

        Args:
            received_ns: when it came [ns since 1970].
            stamp_ns: the stamp in its header [ns].
            simulated_ns: the simulated time when it came [ns]; None: not known.
        """
        if not stamp_ns:
            self.unstamped += 1
            return
        self._taken.append((received_ns, stamp_ns))
        if simulated_ns is not None and is_of_other_clock(received_ns, stamp_ns):
            # `/clock` may come after the message of the same step.
            self._simulated.append(max(0, simulated_ns - stamp_ns))

    def delay(self) -> Delay | None:
        """What was measured; None where no stamped message came."""
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
        """From the first message to the last."""
        (first_ns, first_stamp_ns), (last_ns, last_stamp_ns) = self._taken[0], self._taken[-1]
        passed_ns, stamped_ns = last_ns - first_ns, last_stamp_ns - first_stamp_ns
        return stamped_ns / passed_ns if passed_ns > 0 and stamped_ns > 0 else 1.0

    def _above_the_quickest(self, pace: float) -> list[float]:
        """Delays in wall time [ns]."""
        first_ns, first_stamp_ns = self._taken[0]
        delays = [
            received - first_ns - (stamp - first_stamp_ns) / pace for received, stamp in self._taken
        ]
        least = min(delays)
        return [one - least for one in delays]


HEADER: Final = "std_msgs/Header"
TIME: Final = "builtin_interfaces/Time"
NS: Final = 1_000_000_000


def stamp_getter(msg_type: str, fields_of: FieldsOf) -> Callable[[Any], int]:
    """A function that returns the stamp of a message [ns].

    Args:
        msg_type: `pkg/Name`.
        fields_of: where types are looked up.

    Raises:
        CommandFailedError: such messages have none.
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
