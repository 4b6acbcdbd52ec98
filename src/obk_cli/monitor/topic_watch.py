"""Measure the rates and ages of a stack's topics and compare them with its plan.

The watch yields a `TopicView` for each topic. No message is deserialized. If the plan does not
contain a topic's type, the subscription waits for its publisher.
"""

import struct
from collections import deque
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import partial
from itertools import chain
from typing import Any, Final

from obk_cli.clock import monotonic_s, wall_s
from obk_cli.errors import CommandFailedError
from obk_cli.monitor.expected_topics import PlannedTopic
from obk_cli.monitor.model import MessageAge, TopicView
from obk_cli.ros.field_path import HEADER
from obk_cli.ros.graph import TopicInfo
from obk_cli.ros.meters import (
    WATCH_TURN_S,
    WATCH_WINDOW_S,
    RosMeter,
    TopicRate,
    Watch,
    is_of_other_clock,
    watch_window_s,
)
from obk_cli.ros.participant import RosParticipant
from obk_cli.ros.simulated_clock import SimulatedClock, follow_clock
from obk_cli.ros.types import fields_of, find_type, raw_type, short_type

__all__ = ["RTF_TYPE", "MessageAgeMeter", "TopicWatch"]

_LITTLE: Final = struct.Struct("<iI")
_BIG: Final = struct.Struct(">iI")
_AFTER_ENCAPSULATION: Final = 4
_SHORTEST: Final = _AFTER_ENCAPSULATION + _LITTLE.size
_NS: Final = 1_000_000_000
_KEPT: Final = 1000
_NEAR_ALL: Final = 0.99
_CARRIED: Final = 0.5
"""Minimum fraction of upstream stamps for which a topic counts as forwarding stamps."""


class MessageAgeMeter:
    """Keeps stamps and delays of a topic's latest messages."""

    def __init__(self, window_s: float, clock: SimulatedClock | None = None) -> None:
        """Measure over a window.

        Args:
            window_s: measurement window [s].
            clock: the time base of simulated stamps.
        """
        self._clock = clock or SimulatedClock()
        self._window_ns = round(window_s * _NS)
        self._received: deque[int] = deque(maxlen=_KEPT)
        self._stamps: deque[int] = deque(maxlen=_KEPT)
        self._delays_ns: deque[int] = deque(maxlen=_KEPT)

    def take(self, received_ns: int, data: bytes) -> None:
        """Count a message of a type that starts with a header.

        Args:
            received_ns: time of receipt [ns since 1970].
            data: the serialized message, with its encapsulation.
        """
        if len(data) < _SHORTEST:
            return
        order = _LITTLE if data[1] & 1 else _BIG
        seconds, rest = order.unpack_from(data, _AFTER_ENCAPSULATION)
        stamp = seconds * _NS + rest
        if not stamp:
            return
        self._stamps.append(stamp)
        delay_ns = received_ns - stamp
        if is_of_other_clock(received_ns, stamp):
            now_ns = self._clock.at(received_ns)
            if now_ns is None:
                return
            # `/clock` may arrive after the message of the same step.
            delay_ns = max(0, now_ns - stamp)
        self._received.append(received_ns)
        self._delays_ns.append(delay_ns)

    @property
    def stamps(self) -> Collection[int]:
        """Stamps of the latest messages [ns]."""
        return self._stamps

    def age(self, now_ns: int, upstream: "Collection[MessageAgeMeter]" = ()) -> MessageAge | None:
        """The measured age; None without stamps, or if their clock is unknown.

        Args:
            now_ns: the current time of the receiving clock [ns since 1970].
            upstream: meters of the topics from which this one is made.
        """
        self._forget(now_ns - self._window_ns)
        if not self._delays_ns:
            return None
        delays = sorted(self._delays_ns)
        return MessageAge(
            p50_s=delays[len(delays) // 2] / _NS,
            p99_s=delays[min(len(delays) - 1, int(_NEAR_ALL * len(delays)))] / _NS,
            is_carried=self._are_carried([meter.stamps for meter in upstream if meter.stamps]),
        )

    def _are_carried(self, upstream: Sequence[Collection[int]]) -> bool:
        """Whether the stamps come from upstream, as far back as every upstream topic has stamps."""
        since = max(map(min, upstream), default=0)
        known = frozenset(chain.from_iterable(upstream))
        judged = [stamp for stamp in self._stamps if stamp >= since]
        return sum(stamp in known for stamp in judged) > _CARRIED * len(judged)

    def _forget(self, before_ns: int) -> None:
        # Keep old stamps: topics further downstream are compared with them later.
        while self._received and self._received[0] < before_ns:
            self._received.popleft()
            self._delays_ns.popleft()


FOUND_S: Final = 0.5
"""Time for a publisher to discover a new subscription [s]."""
PERIODS_TO_JUDGE: Final = 3
FACTOR_WINDOW_S: Final = 3.0
"""Window of real-time factors: that of rates plus the 1 s before each factor [s]."""
FACTORS_KEPT: Final = 5
RTF_TYPE: Final = "std_msgs/msg/Float64"
EVENTS: Final = "/parameter_events"
EVENTS_TYPE: Final = "rcl_interfaces/msg/ParameterEvent"
_RTF: Final = struct.Struct("<4xd")
"""CDR of a `Float64` in the usual byte order."""


class TopicWatch:
    """Counts the messages of topics; call `turn_for` repeatedly."""

    def __init__(self, participant: RosParticipant) -> None:
        """Start without topics.

        Args:
            participant: a participant.
        """
        self._participant = participant
        self._meter = RosMeter(participant, WATCH_WINDOW_S, WATCH_TURN_S)
        self._topics: dict[str, PlannedTopic] = {}
        self._age_meters: dict[str, MessageAgeMeter | None] = {}
        self._expected_since: dict[str, float] = {}
        self._clock = SimulatedClock()
        self._factors: dict[str, deque[tuple[float, float]]] = {}
        """Topic -> times of receipt [s] and values of the latest real-time factors."""
        self.realtime_factor: float | None = None
        """The latest received factor."""

    def set_topics(self, topics: Iterable[PlannedTopic]) -> None:
        """Measure these topics, in this order; topics that are already measured continue."""
        self._topics = {topic.name: topic for topic in topics}
        for name in [name for name in self._age_meters if name not in self._topics]:
            self._meter.drop(name)
            del self._age_meters[name]
        for topic in self._topics.values():
            if topic.msg_type is not None and topic.name not in self._age_meters:
                self._subscribe_planned(topic, topic.msg_type)

    def watch_realtime_factor(self, topic: str) -> None:
        """Subscribe to the real-time factor that a simulator publishes."""
        self._meter.add(topic, RTF_TYPE, find_type(RTF_TYPE), partial(self._take_rtf, topic=topic))

    def measured_factor(self, topic: str) -> float | None:
        """The speed of a simulation over the window of rates; 0 while it is paused.

        From `/clock` if one simulator publishes it, otherwise from the received real-time factors.

        Args:
            topic: the topic of the simulator's real-time factor.

        Returns:
            None if it was not measured yet.
        """
        pace = self._clock.pace(round((wall_s() - WATCH_WINDOW_S) * _NS))
        if pace is not None and self._factors.keys() <= {topic}:
            return pace
        taken = self._factors.get(topic)
        if not taken:
            return None
        since_s = monotonic_s() - FACTOR_WINDOW_S
        newest = [factor for taken_s, factor in taken if taken_s > since_s]
        return sum(newest) / len(newest) if newest else 0.0

    def watch_clock(self) -> None:
        """Subscribe to `/clock`, for ages of simulated stamps and the speed of the simulation."""
        follow_clock(self._meter, self._clock)

    def watch_parameter_events(self, on_event: Watch) -> None:
        """Subscribe to the parameter events of all nodes."""
        self._meter.add(EVENTS, EVENTS_TYPE, find_type(EVENTS_TYPE), on_event)

    def turn(self) -> None:
        """Count received messages; returns after 20 ms."""
        self._meter.turn()

    def turn_for(self, seconds: float) -> None:
        """Count received messages for this time [s]."""
        end = monotonic_s() + seconds
        while monotonic_s() < end:
            self._meter.turn()

    def views(self, active: Collection[str]) -> tuple[TopicView, ...]:
        """The current state of the topics.

        Args:
            active: full names of the active nodes.
        """
        rates = self._meter.rates()
        return tuple(self._view(topic, rates, active) for topic in self._topics.values())

    def _view(
        self, topic: PlannedTopic, rates: Mapping[str, TopicRate], active: Collection[str]
    ) -> TopicView:
        found = self._participant.topic(topic.name)
        if topic.name not in self._age_meters:
            self._subscribe_discovered(topic, found)
        own = self._participant.name
        meter = self._age_meters.get(topic.name)
        up = [one for name in topic.made_from if (one := self._age_meters.get(name))]
        return TopicView(
            topic=topic.name,
            msg_type=topic.msg_type or next(iter(found.msg_types), None),
            publishers=len(found.publishers),
            subscriptions=sum(end.node != own for end in found.subscriptions),
            expected_hz=topic.expected_hz,
            rate=rates.get(topic.name),
            age=meter.age(round(wall_s() * 1e9), up) if meter else None,
            is_expected=self._is_expected(topic, active),
            made_from=topic.made_from,
        )

    def _is_expected(self, topic: PlannedTopic, active: Collection[str]) -> bool:
        """Whether its publishers are active, and were measured for long enough."""
        if topic.name not in self._age_meters or not topic.publishers:
            return False
        now = monotonic_s()
        if not set(topic.publishers) <= set(active):
            self._expected_since[topic.name] = now
            return False
        wait_s = FOUND_S + (PERIODS_TO_JUDGE / topic.expected_hz if topic.expected_hz else 0.0)
        return now - self._expected_since[topic.name] >= wait_s

    def _subscribe_planned(self, topic: PlannedTopic, msg_type: str) -> None:
        try:
            self._subscribe(topic, msg_type, find_type(msg_type))
        except CommandFailedError:
            return  # not built here: subscribe once its publisher names the type

    def _subscribe_discovered(self, topic: PlannedTopic, found: TopicInfo) -> None:
        if len(found.msg_types) != 1 or not found.publishers:
            return
        (msg_type,) = found.msg_types
        try:
            python_type = raw_type(msg_type, (end.type_hash for end in found.publishers))
            self._subscribe(topic, msg_type, python_type)
        except CommandFailedError:
            return

    def _subscribe(self, topic: PlannedTopic, msg_type: str, python_type: Any) -> None:
        window_s = watch_window_s(1 / topic.expected_hz if topic.expected_hz else 0.0)
        meter = MessageAgeMeter(window_s, self._clock) if _begins_with_header(msg_type) else None
        watch = meter.take if meter is not None else None
        self._meter.add(topic.name, msg_type, python_type, watch, window_s=window_s, is_light=True)
        self._age_meters[topic.name] = meter
        self._expected_since[topic.name] = monotonic_s()

    def _take_rtf(self, _received_ns: int, data: bytes, topic: str = "") -> None:
        if len(data) >= _RTF.size:  # otherwise it is another type of message
            (self.realtime_factor,) = _RTF.unpack_from(data)
            newest = self._factors.setdefault(topic, deque(maxlen=FACTORS_KEPT))
            newest.append((monotonic_s(), self.realtime_factor))


def _begins_with_header(msg_type: str) -> bool:
    try:
        return next(iter(fields_of(short_type(msg_type)).values()), "") == HEADER
    except CommandFailedError:
        return False
