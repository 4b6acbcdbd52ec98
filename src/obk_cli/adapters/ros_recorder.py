"""Records topics of a ROS graph: serialized messages, taken in turns, straight into a file.

Nothing is deserialized and no executor is used: every few milliseconds whatever has come is taken
from each subscription. A topic is subscribed once its type is known, a named one of known type
before it has a publisher. Never holds a publisher up: what comes too fast is lost here, counted.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from obk_cli.adapters.bag_writer import FLUSH_S, BagWriter
from obk_cli.adapters.definitions import installed_definition
from obk_cli.recording.choice import Wish, chosen_topics, clashing_topics, unmet_wishes
from obk_cli.recording.qos import offers_text
from obk_cli.recording.schema_text import schema_text
from obk_cli.recording.tally import Tally
from obk_cli.ros.raw_subscription import RawTopic
from obk_cli.ros.types import find_type

__all__ = ["RosRecorder"]

TURN_S: Final = 0.005
"""Between two looks at the subscriptions [s]."""
LOOK_S: Final = 0.1
"""Between two looks at the ROS graph [s]."""
TELL_S: Final = 5.0
"""Between two words on messages that were lost [s]."""


@dataclass(slots=True, kw_only=True)
class _Topic:
    """One topic that is recorded."""

    raw: RawTopic
    tally: Tally = field(default_factory=Tally)
    channel: int | None = None


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
        self._clashing: set[str] = set()
        self._flushed = self._looked = self._told = time.monotonic()
        self._told_drops = 0
        self.look()

    @property
    def tallies(self) -> Mapping[str, Tally]:
        """How much of each topic was recorded."""
        return {name: topic.tally for name, topic in self._topics.items()}

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
            tally, publishers = topic.tally, topic.raw.publishers
            for data, info in topic.raw.take():
                sequence = info["publication_sequence_number"]
                tally.take(sequence, publishers)
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
        for name, kinds in clashing_topics(self._wish, graph).items():
            if name not in self._topics and name not in self._clashing:
                self._clashing.add(name)
                types = " and ".join(kinds)
                self._tell(f"warning: {name} is not recorded while it has the types {types}")
        for topic in self._topics.values():
            topic.raw.look()

    def finish(self) -> None:
        """Write what is still there; topics without a message are in the recording too.

        Raises:
            OSError: the file takes no more.
        """
        self.take()
        for topic in self._topics.values():
            if topic.channel is None:
                self._channel(topic)
        for sentence in unmet_wishes(self._wish, {*self._topics, *self._refused, *self._clashing}):
            self._tell(f"warning: {sentence}: nothing of it is recorded")
        self._tell_drops()

    def _begin(self, name: str, msg_type: str) -> None:
        try:
            raw = RawTopic(self._node.handle, name, msg_type, find_type(msg_type))
        except Exception as error:  # whatever a generated package may raise
            self._refused.add(name)
            self._tell(f"warning: {name} is not recorded: {error}")
            return
        self._topics[name] = _Topic(raw=raw)

    def _channel(self, topic: _Topic) -> int:
        raw = topic.raw
        raw.learn()
        definition = schema_text(raw.msg_type, installed_definition)
        if definition is None:
            self._tell(f"warning: {raw.name}: the definition of {raw.msg_type} is not found")
        topic.channel = self._writer.add_topic(
            raw.name,
            raw.msg_type,
            definition or "",
            {
                "offered_qos_profiles": offers_text(raw.offers),
                "topic_type_hash": min(raw.hashes, default=""),
            },
        )
        return topic.channel

    def _tell_drops(self) -> None:
        if self.dropped > self._told_drops:
            self._told_drops = self.dropped
            names = [name for name, topic in self._topics.items() if topic.tally.dropped]
            self._tell(f"warning: {self.dropped} messages were lost so far, of {', '.join(names)}")
