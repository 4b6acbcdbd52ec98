"""Records topics of a ROS graph: serialized messages, taken in turns, straight into a file.

Nothing is deserialized and no executor is used: every few milliseconds whatever has come is taken
from each subscription. A topic is subscribed once its type is known, a named one of known type
before it has a publisher. Never holds a publisher up: what comes too fast is lost here, counted.
"""

import importlib
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from obk_cli.adapters.bag_writer import FLUSH_S, BagWriter
from obk_cli.adapters.definitions import installed_definition
from obk_cli.recording.choice import Wish, chosen_topics
from obk_cli.recording.qos import Offer, Request, offers_text, request_for
from obk_cli.recording.schema_text import schema_text
from obk_cli.recording.tally import Tally

__all__ = ["RosRecorder"]

TURN_S: Final = 0.005
"""Between two looks at the subscriptions [s]."""
LOOK_S: Final = 0.1
"""Between two looks at the ROS graph [s]."""
TELL_S: Final = 5.0
"""Between two words on messages that were lost [s]."""
DEPTH: Final = 1000
"""Messages of a topic that may wait here: a second of one at 1 kHz."""


@dataclass(slots=True, kw_only=True)
class _Topic:
    """One topic that is recorded."""

    name: str
    msg_type: str
    python_type: Any
    request: Request
    subscription: Any
    tally: Tally = field(default_factory=Tally)
    channel: int | None = None
    publishers: int = 0


class RosRecorder:
    """Subscribes and writes, all in the thread that calls `turn`."""

    def __init__(
        self, node: Any, writer: BagWriter, wish: Wish, tell: Callable[[str], None]
    ) -> None:
        """Subscribe to what is known already.

        Args:
            node: of rclpy; nobody spins it.
            writer: takes the messages.
            wish: which topics.
            tell: takes sentences for the user.
        """
        self._node = node
        self._writer = writer
        self._wish = wish
        self._tell = tell
        self._topics: dict[str, _Topic] = {}
        self._refused: set[str] = set()
        self._flushed = self._looked = self._told = time.monotonic()
        self._told_drops = 0
        self.look()

    @property
    def tallies(self) -> Mapping[str, Tally]:
        """How much of each topic was recorded."""
        return {topic.name: topic.tally for topic in self._topics.values()}

    @property
    def dropped(self) -> int:
        """Messages that were lost on the way here, of all topics."""
        return sum(topic.tally.dropped for topic in self._topics.values())

    def turn(self) -> None:
        """Write what has come, look for new topics when it is time; takes a few milliseconds.

        Raises:
            OSError: the file takes no more.
        """
        begin = time.monotonic()
        self.take()
        if begin - self._flushed > FLUSH_S:
            self._writer.flush()
            self._flushed = begin
        if begin - self._looked > LOOK_S:
            self._looked = begin
            self.look()
        if begin - self._told > TELL_S:
            self._told = begin
            self._tell_drops()
        time.sleep(max(0.0, TURN_S - (time.monotonic() - begin)))

    def take(self) -> None:
        """Write what has come.

        Raises:
            OSError: the file takes no more.
        """
        for topic in self._topics.values():
            take, tally, kind = (
                topic.subscription.handle.take_message,
                topic.tally,
                topic.python_type,
            )
            # No more than may wait, so that one topic does not keep the others waiting.
            for _ in range(DEPTH):
                taken = take(kind, True)
                if taken is None:
                    break
                data, info = taken
                sequence = info["publication_sequence_number"]
                tally.take(sequence, topic.publishers)
                self._writer.add_message(
                    self._channel(topic) if topic.channel is None else topic.channel,
                    data,
                    info["received_timestamp"],
                    info["source_timestamp"],
                    sequence,
                )

    def look(self) -> None:
        """Subscribe to topics that have come, and anew where a publisher's offer asks for it."""
        graph = dict(self._node.get_topic_names_and_types())
        for name, msg_type in chosen_topics(self._wish, graph).items():
            if name not in self._topics and name not in self._refused:
                self._begin(name, msg_type)
        for topic in self._topics.values():
            ends = self._node.get_publishers_info_by_topic(topic.name)
            topic.publishers = len(ends)
            request = request_for([_offer(end.qos_profile) for end in ends])
            # What was published before is asked for only while nothing has come: no doubles.
            is_weaker = topic.request.is_reliable and not request.is_reliable
            is_latched = request.is_transient_local and not topic.request.is_transient_local
            if ends and (is_weaker or (is_latched and not topic.tally.count)):
                self._node.destroy_subscription(topic.subscription)
                topic.request = request
                topic.subscription = self._subscribe(topic.name, topic.python_type, request)

    def finish(self) -> None:
        """Write what is still there; topics without a message are in the recording too.

        Raises:
            OSError: the file takes no more.
        """
        self.take()
        for topic in self._topics.values():
            if topic.channel is None:
                self._channel(topic)
        self._tell_drops()

    def _begin(self, name: str, msg_type: str) -> None:
        try:
            package, _, kind = msg_type.split("/")
            python_type = getattr(importlib.import_module(f"{package}.msg"), kind)
            request = Request()
            subscription = self._subscribe(name, python_type, request)
        except Exception as error:  # whatever a generated package may raise
            self._refused.add(name)
            self._tell(f"warning: {name} is not recorded: no type `{msg_type}` here ({error})")
            return
        self._topics[name] = _Topic(
            name=name,
            msg_type=msg_type,
            python_type=python_type,
            request=request,
            subscription=subscription,
        )

    def _subscribe(self, name: str, python_type: Any, request: Request) -> Any:
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        reliability = ReliabilityPolicy
        durability = DurabilityPolicy
        qos = QoSProfile(  # type: ignore[no-untyped-call]
            depth=DEPTH,
            reliability=reliability.RELIABLE if request.is_reliable else reliability.BEST_EFFORT,
            durability=(
                durability.TRANSIENT_LOCAL if request.is_transient_local else durability.VOLATILE
            ),
        )
        return self._node.create_subscription(python_type, name, _nobody, qos, raw=True)

    def _channel(self, topic: _Topic) -> int:
        ends = self._node.get_publishers_info_by_topic(topic.name)
        hashes = {str(end.topic_type_hash) for end in ends}
        definition = schema_text(topic.msg_type, installed_definition)
        if definition is None:
            self._tell(f"warning: {topic.name}: the definition of {topic.msg_type} is not found")
        topic.channel = self._writer.add_topic(
            topic.name,
            topic.msg_type,
            definition or "",
            {
                "offered_qos_profiles": offers_text(_offer(end.qos_profile) for end in ends),
                "topic_type_hash": min(hashes, default=""),
            },
        )
        return topic.channel

    def _tell_drops(self) -> None:
        if self.dropped > self._told_drops:
            self._told_drops = self.dropped
            names = [t.name for t in self._topics.values() if t.tally.dropped]
            self._tell(f"warning: {self.dropped} messages were lost so far, of {', '.join(names)}")


def _nobody(_: bytes) -> None:
    """The callback that a subscription must have; nobody spins it."""


def _offer(qos: Any) -> Offer:
    return Offer(
        history=qos.history.name.lower(),
        depth=qos.depth,
        reliability=qos.reliability.name.lower(),
        durability=qos.durability.name.lower(),
        liveliness=qos.liveliness.name.lower(),
        deadline_ns=qos.deadline.nanoseconds,
        lifespan_ns=qos.lifespan.nanoseconds,
        lease_ns=qos.liveliness_lease_duration.nanoseconds,
    )
