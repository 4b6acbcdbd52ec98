"""Route messages from publishers to subscriptions in a lockstep run, without DDS.

Each subscription receives its own copy, as from the network, and keeps a history with the depth of
its QoS profile, which drops the oldest message. QoS profiles match as in DDS. A late subscription
receives the messages kept by transient-local publishers.
"""

import inspect
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any, Final, cast

from rclpy.lifecycle.publisher import LifecyclePublisher
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.subscription import Subscription

from obelisk_py.core.intra_process import is_compatible
from obelisk_py.core.lockstep.scheduler import MESSAGE, Arrival, ScheduledNode, Scheduler
from obelisk_py.core.messages import message_name
from obelisk_py.core.serialization.codec import codec_for

__all__ = [
    "LockstepLifecyclePublisher",
    "LockstepPublisher",
    "MessageRule",
    "RoutedPublisher",
    "Topic",
    "TopicTable",
]

MessageRule = Callable[[int, Any], int | None]
"""Time of publication [ns], message or bytes -> additional delay [ns]; None drops the message."""
_INTERNAL: Final = ("/parameter_events", "/rosout", "/diagnostics")
"""Topics that are not recorded; log messages are kept as text."""
_LONGEST_LIFESPAN_NS: Final = 10**18
"""Longer lifespans are infinite; middlewares represent infinity differently [ns]."""
_UNLIMITED: Final = 1 << 31


class _RclpyCodec:
    """Uses rclpy to serialize messages that the library's codecs do not support."""

    def __init__(self, message_class: type[Any]) -> None:
        self._class = message_class

    def pack(self, message: Any) -> bytes:
        return bytes(serialize_message(message))

    def unpack(self, data: bytes) -> Any:
        return deserialize_message(data, self._class)

    def copy(self, message: Any) -> Any:
        return self.unpack(self.pack(message))


class Topic:
    """A topic with its message type."""

    def __init__(self, name: str, message_class: type[Any], *, is_watched: bool) -> None:
        self.label = name
        self.message_class = message_class
        self.codec: Any = codec_for(cast(Any, message_class)) or _RclpyCodec(message_class)
        self.log: list[tuple[int, int, bytes]] | None = None
        """Time of publication [ns], position among the run's messages, and bytes of each message;
        None if the topic is not recorded."""
        self.subscribers: tuple[_Subscriber, ...] = ()
        self.publishers: list[RoutedPublisher] = []
        self.rules: list[MessageRule] = []
        self.filters: list[Callable[[int, Any], None]] = []
        """Functions that modify a message when it is published; called with the time [ns]."""
        self.is_watched = is_watched
        """Whether the topic counts as subscribed even without a subscription."""
        self.lacked_subscribers = False
        """Whether none existed when a publisher last asked for the number of subscriptions."""

    def delay_ns(self, sent_ns: int, message: Any) -> int | None:
        """The delay that the rules add to a message or its bytes [ns]; None if one drops it."""
        total_ns = 0
        for rule in self.rules:
            delay_ns = rule(sent_ns, message)
            if delay_ns is None:
                return None
            total_ns += delay_ns
        return total_ns


class _Subscriber:
    """A subscription and its history."""

    __slots__ = (
        "call",
        "depth",
        "label",
        "node",
        "queue",
        "raw",
        "subscription",
        "topic",
        "unpack",
    )

    def __init__(self, node: ScheduledNode, subscription: Subscription, topic: Topic) -> None:
        profile = subscription.qos_profile
        self.topic = topic
        self.label = topic.label
        self.node = node
        self.subscription = subscription
        self.unpack = topic.codec.unpack
        self.raw = subscription.raw
        keeps_all = profile.history == HistoryPolicy.KEEP_ALL
        self.depth = _UNLIMITED if keeps_all else max(1, profile.depth)
        self.queue: deque[_Arrival] = deque()
        """Messages that have arrived and were not delivered yet."""
        self.call = self._call()

    def _call(self) -> Callable[[Any, int], None]:
        """Build the function that is called with a message and its time of publication [ns]."""
        callback = self.subscription.callback
        has_info = self.subscription._callback_type is Subscription.CallbackType.WithMessageInfo
        is_coroutine = inspect.iscoroutinefunction(callback)
        if not has_info and not is_coroutine:
            return lambda message, _sent_ns: callback(message)
        node = self.node.node

        def call(message: Any, sent_ns: int) -> None:
            now_ns = node.get_clock().now().nanoseconds
            infos = (_info(sent_ns, now_ns),) if has_info else ()
            if is_coroutine:
                node.executor.run_coroutine(callback(message, *infos), self.node)
            else:
                callback(message, *infos)

        return call


def _info(sent_ns: int, received_ns: int) -> dict[str, int | None]:
    return {
        "source_timestamp": sent_ns,
        "received_timestamp": received_ns,
        "publication_sequence_number": None,
        "reception_sequence_number": None,
    }


class TopicTable:
    """The topics of a run, by full name."""

    def __init__(
        self,
        scheduler: Scheduler,
        *,
        watched: Iterable[str] = (),
        is_recorded: Callable[[str], bool] = lambda _: True,
    ) -> None:
        """Create an empty table.

        Args:
            scheduler: delivers the messages.
            watched: topics that count as subscribed even without a subscriber.
            is_recorded: whether the messages of a topic are recorded.
        """
        self.by_name: dict[str, Topic] = {}
        self._scheduler = scheduler
        self._watched = frozenset(watched)
        self._is_recorded = is_recorded

    def topic(self, name: str, message_class: type[Any]) -> Topic:
        """Return the topic with this name; it is created at first use."""
        topic = self.by_name.get(name)
        if topic is not None and topic.message_class is message_class:
            return topic
        if topic is not None:
            # As in DDS, endpoints with different types do not match.
            self._scheduler.note(
                ("type", name),
                f"{name} has endpoints of the types {message_name(topic.message_class)} and "
                f"{message_name(message_class)}, which do not match",
            )
            return Topic(name, message_class, is_watched=False)
        topic = Topic(name, message_class, is_watched=name in self._watched)
        if name not in _INTERNAL and self._is_recorded(name):
            topic.log = []
        self.by_name[name] = topic
        return topic

    def subscribe(self, node: ScheduledNode, subscription: Subscription) -> None:
        """Deliver future messages to a subscription, and those kept for late subscribers."""
        topic = self.topic(subscription.topic_name, cast(Any, subscription.msg_type))
        subscriber = _Subscriber(node, subscription, topic)
        topic.subscribers = (*topic.subscribers, subscriber)
        if subscription.qos_profile.durability != DurabilityPolicy.TRANSIENT_LOCAL:
            return
        for publisher in topic.publishers:
            if matches(publisher, subscriber):
                for data in publisher.kept:
                    self.send(subscriber, data, self._scheduler.time_ns)

    def unsubscribe(self, subscription: Subscription) -> None:
        """Stop delivering messages to a subscription."""
        topic = self.by_name.get(subscription.topic_name)
        for subscriber in topic.subscribers if topic is not None else ():
            if subscriber.subscription is subscription:
                self._close(subscriber)

    def _close(self, subscriber: _Subscriber) -> None:
        topic = subscriber.topic
        topic.subscribers = tuple(each for each in topic.subscribers if each is not subscriber)
        subscriber.queue.clear()

    def publish(self, name: str, message: Any) -> None:
        """Publish a message from outside the run; it arrives without latency."""
        topic = self.topic(name, type(message))
        self.publish_bytes(topic, topic.codec.pack(message))

    def publish_bytes(self, topic: Topic, data: bytes, latency_ns: int = 0) -> None:
        """Publish a serialized message from outside the run."""
        now_ns = self._scheduler.time_ns
        if topic.filters:
            data = topic.codec.pack(_filtered(topic, data, now_ns))
        if topic.log is not None:
            topic.log.append((now_ns, self._scheduler.next_place(), data))
        delay_ns = topic.delay_ns(now_ns, data)
        if delay_ns is not None:
            for subscriber in topic.subscribers:
                self.send(subscriber, data, now_ns + latency_ns + delay_ns)

    def note_lifespan(self, node: ScheduledNode, name: str) -> None:
        """Note that a publisher's lifespan has no effect."""
        self._scheduler.note(
            ("lifespan", name, node.name),
            f"{node.name} publishes {name} with a lifespan, which has no effect in lockstep",
        )

    def leave(self, node: ScheduledNode) -> None:
        """Remove all endpoints of a node."""
        for topic in self.by_name.values():
            for subscriber in topic.subscribers:
                if subscriber.node is node:
                    self._close(subscriber)
            for publisher in list(topic.publishers):
                if publisher.owner is node:
                    publisher.leave()

    def send(self, subscriber: _Subscriber, message: Any, arrives_ns: int) -> None:
        """Deliver a message, or its bytes, to one subscription at a time [ns]."""
        scheduler = self._scheduler
        sent_ns = scheduler.now_ns + scheduler.offset_ns
        arrival = _Arrival(subscriber, scheduler.next_place(), sent_ns, message)
        if arrives_ns > scheduler.now_ns:
            call: Callable[[], bool] = arrival
        else:  # it arrives now
            arrives_ns, call = scheduler.now_ns, arrival.enqueue()
        scheduler.push_at_place(arrives_ns, MESSAGE, arrival.place, subscriber.node, call)


class _Arrival(Arrival):
    """A message on its way to a subscription."""

    __slots__ = ("_message", "_sent_ns", "_subscriber", "place")

    def __init__(self, subscriber: _Subscriber, place: int, sent_ns: int, message: Any) -> None:
        self.place = place
        self._subscriber = subscriber
        self._sent_ns = sent_ns
        self._message = message

    @property
    def label(self) -> str:
        return self._subscriber.label

    def __call__(self) -> bool:
        # If others wait, this one may displace the oldest. Otherwise it skips the history.
        return self.enqueue()() if self._subscriber.queue else self._deliver()

    def enqueue(self) -> Callable[[], bool]:
        queue = self._subscriber.queue
        if len(queue) >= self._subscriber.depth:
            queue.popleft()
        queue.append(self)
        return self._leave_queue

    def _leave_queue(self) -> bool:
        try:
            self._subscriber.queue.remove(self)
        except ValueError:
            return False  # dropped from the history by newer messages
        return self._deliver()

    def _deliver(self) -> bool:
        subscriber, message = self._subscriber, self._message
        if subscriber not in subscriber.topic.subscribers:
            return False
        if not subscriber.raw and isinstance(message, bytes):
            message = subscriber.unpack(message)
        subscriber.call(message, self._sent_ns)
        return True


def _filtered(topic: Topic, message: Any, now_ns: int) -> Any:
    codec = topic.codec
    own = codec.unpack(message) if isinstance(message, bytes) else codec.copy(message)
    for change in topic.filters:
        change(now_ns, own)
    return own


def matches(publisher: "RoutedPublisher", subscriber: _Subscriber) -> bool:
    """Whether DDS would match a publisher and a subscription.

    Source: OMG DDS 1.4, 2.2.3 (offered versus requested reliability and durability).
    """
    offered, requested = publisher.qos_profile, subscriber.subscription.qos_profile
    is_late_joiner = requested.durability == DurabilityPolicy.TRANSIENT_LOCAL
    keeps = offered.durability == DurabilityPolicy.TRANSIENT_LOCAL
    return is_compatible(offered, requested) and (keeps or not is_late_joiner)


class RoutedPublisher(Publisher):
    """Publishes to the subscriptions of its run; the base class of both publishers."""

    def join(self, table: TopicTable, node: ScheduledNode) -> None:
        """Add the publisher to the topics of a run."""
        self.owner = node
        self.kept: deque[bytes] = deque(maxlen=0)
        """Messages for late subscriptions."""
        profile = self.qos_profile
        if profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            keeps_all = profile.history == HistoryPolicy.KEEP_ALL
            self.kept = deque(maxlen=None if keeps_all else max(1, profile.depth))
        self._keeps = self.kept.maxlen != 0
        self._latest_ns = 0
        """Arrival of the latest message, without the delay of a test's rules [ns]."""
        if 0 < profile.lifespan.nanoseconds < _LONGEST_LIFESPAN_NS:
            table.note_lifespan(node, self.topic_name)
        self._table = table
        self._scheduler = table._scheduler
        self._topic = table.topic(self.topic_name, cast(Any, self.msg_type))
        self._topic.publishers.append(self)
        self._all: tuple[_Subscriber, ...] = ()
        self._matched: tuple[_Subscriber, ...] = ()

    def send(self, message: Any) -> None:
        """Publish a message, or the bytes of a serialized one.

        Raises:
            TypeError: `message` is neither a message of the topic's type nor `bytes`.
            ObeliskMsgError: a field has a value that its type cannot hold.
        """
        topic, scheduler = self._topic, self._scheduler
        now_ns = scheduler.now_ns + scheduler.offset_ns
        if topic.filters:
            message = _filtered(topic, message, now_ns)
        is_packed = isinstance(message, bytes)
        if not is_packed and not isinstance(message, topic.message_class):
            raise TypeError(f"Expected {topic.message_class}, got {type(message)}")
        node = scheduler.running
        sent_ns = now_ns + (node.compute_ns if node is not None else 0)
        subscribers = self._matched if self._all is topic.subscribers else self._match()
        data: Any = message if is_packed else None
        if data is None and (topic.log is not None or self._keeps or not subscribers):
            data = topic.codec.pack(message)  # also detects values that cannot be serialized
        if topic.log is not None:
            topic.log.append((sent_ns, scheduler.next_place(), data))
        if self._keeps:
            self.kept.append(data)
        # As in DDS, jitter does not change the order of a publisher's messages.
        arrives_ns = max(sent_ns + scheduler.delay_ns(topic.label), self._latest_ns)
        self._latest_ns = arrives_ns
        if topic.rules:
            delay_ns = topic.delay_ns(sent_ns, message)
            if delay_ns is None:
                return
            arrives_ns += delay_ns
        for subscriber in subscribers:
            if is_packed:
                copy = message
            elif subscriber.raw:
                copy = data if data is not None else topic.codec.pack(message)
            else:
                copy = topic.codec.copy(message)
            self._table.send(subscriber, copy, arrives_ns)

    def _match(self) -> tuple[_Subscriber, ...]:
        self._all = subscribers = self._topic.subscribers
        self._matched = tuple(each for each in subscribers if matches(self, each))
        for each in subscribers:
            if each not in self._matched:
                self._note_mismatch(each)
        return self._matched

    def _note_mismatch(self, subscriber: _Subscriber) -> None:
        ends = self.owner.name, subscriber.node.name
        self._scheduler.note(
            ("qos", self._topic.label, *ends),
            f"{self._topic.label}: the QoS that {ends[0]} offers does not match the QoS that "
            f"{ends[1]} requests, so no message passes between them",
        )

    def get_subscription_count(self) -> int:
        """Number of matching subscriptions; a watched topic counts one more."""
        topic = self._topic
        matched = self._matched if self._all is topic.subscribers else self._match()
        count = len(matched) + topic.is_watched
        topic.lacked_subscribers = count == 0
        return count

    def wait_for_all_acked(self, timeout: Any = None) -> bool:
        """Always true: every published message arrives."""
        del timeout
        return True

    def leave(self) -> None:
        """Stop publishing, to subscriptions and to the recording."""
        if self in self._topic.publishers:
            self._topic.publishers.remove(self)
        self.send = _ignore  # type: ignore[assignment, method-assign]

    def destroy(self) -> None:
        """Destroy the publisher; for `Node.destroy_publisher`."""
        self.leave()
        super().destroy()


def _ignore(_message: Any) -> None:
    """Drop a message."""


class LockstepPublisher(RoutedPublisher):
    """A publisher without a lifecycle."""

    def publish(self, msg: Any) -> None:
        """Publish a message, or the bytes of a serialized one."""
        self.send(msg)


class LockstepLifecyclePublisher(RoutedPublisher, LifecyclePublisher):
    """A publisher that drops messages while its node is not active."""

    def publish(self, msg: Any) -> None:
        """Publish a message, or the bytes of a serialized one, if the publisher is enabled."""
        if self._enabled:
            self.send(msg)
