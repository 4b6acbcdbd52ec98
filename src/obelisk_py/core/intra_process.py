"""Deliver messages within a process with a single copy, bypassing DDS.

Each subscription that runs in the library's executor has a buffer, registered by context and topic.
A publisher puts its messages into the buffers of the subscriptions that DDS would match, and
bypasses DDS as long as DDS reports no further subscriptions. A `LocalSender` serves the
subscriptions in other processes of the run. Once there is a subscription that neither a buffer nor
a `LocalSender` can serve, all subscriptions receive the messages through DDS.

The following holds for each publisher and subscription, even while others are added and removed:

- No message is delivered twice: each goes either to the buffers or to DDS.
- Every message that DDS would deliver is delivered. A subscription in another process receives the
  messages published after the publisher discovered it, as with DDS alone. A buffer holds up to
  `history_depth` messages and then drops the oldest. While DDS still holds messages for the
  subscription, the limit applies to the buffer and to DDS separately.
- Messages arrive in the order in which they were published, provided that DDS delivers within
  `publish`, as Fast DDS does within a process. A publisher that has sent through DDS continues to
  do so until the subscription has taken everything that DDS held for it. With
  `RMW_FASTRTPS_PUBLICATION_MODE=ASYNCHRONOUS`, messages may be reordered while a subscription in
  another process is being added or removed. Messages from different publishers have no defined
  order.
- When a subscription is destroyed, its waiting messages are dropped, as with DDS. When its node is
  removed from an `EventLoopExecutor`, waiting messages are delivered as soon as such an executor
  runs the node again. Other executors do not see them.
"""

import functools
import os
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, Final

from rclpy.context import Context
from rclpy.lifecycle.publisher import LifecyclePublisher
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.subscription import Subscription
from rclpy.utilities import get_rmw_implementation_identifier

from obelisk_py.core.local_sender import LocalSender, socket_folder
from obelisk_py.core.messages import message_name
from obelisk_py.core.serialization.codec import Codec, codec_for

__all__ = [
    "IntraProcessPublisher",
    "IntraProcessTopic",
    "MessageBuffer",
    "buffer_of",
    "disconnect_all",
    "intra_process_topic",
    "is_compatible",
]

_RELIABILITIES: Final = (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT)
_LIVELINESSES: Final = (LivelinessPolicy.SYSTEM_DEFAULT, LivelinessPolicy.AUTOMATIC)
_UNSET: Final = QoSProfile(depth=1)
_LINGER_S: Final = 0.2
"""How long a publisher that is destroyed waits for subscriptions that do not read [s]."""


@functools.cache
def middleware_is_known() -> bool:
    """Whether this module can predict which subscriptions the middleware would match.

    Fast DDS matches the endpoints of a context before it returns from the call that creates one.
    It uses the QoS profiles that the node sets, unless the process loads profiles from XML.
    """
    return (
        get_rmw_implementation_identifier() == "rmw_fastrtps_cpp"
        and os.environ.get("RMW_FASTRTPS_USE_QOS_FROM_XML") != "1"
    )


def is_plain(qos: QoSProfile) -> bool:
    """Whether a profile only sets history, depth and reliability.

    Anything else is left to DDS: transient-local durability, deadlines, lifespans and liveliness.
    """
    return bool(
        qos.history == HistoryPolicy.KEEP_LAST
        and qos.depth > 0
        and qos.reliability in _RELIABILITIES
        and qos.durability == DurabilityPolicy.VOLATILE
        and qos.liveliness in _LIVELINESSES
        and qos.deadline == _UNSET.deadline
        and qos.lifespan == _UNSET.lifespan
        and qos.liveliness_lease_duration == _UNSET.liveliness_lease_duration
        # Without these conventions, the name denotes a different DDS topic.
        and not qos.avoid_ros_namespace_conventions
    )


def is_compatible(publisher: QoSProfile, subscription: QoSProfile) -> bool:
    """Whether DDS matches two plain profiles: a reliable subscription needs a reliable publisher.

    Source: OMG DDS 1.4, 2.2.3.14 (RELIABILITY, offered versus requested).
    """
    return bool(
        publisher.reliability == ReliabilityPolicy.RELIABLE
        or subscription.reliability == ReliabilityPolicy.BEST_EFFORT
    )


_INFO: Final = {
    "source_timestamp": 0,
    "received_timestamp": 0,
    "publication_sequence_number": None,
    "reception_sequence_number": None,
}
"""A placeholder. A subscription whose original callback takes a `MessageInfo` uses DDS, so only a
callback that was assigned later can receive this."""


class MessageBuffer:
    """A subscription's messages that bypassed DDS, and an eventfd that signals them.

    Any thread may put messages in; the threads that run the subscription take them out. The buffer
    also tracks whether DDS may hold messages from the same publishers, so that later messages do
    not overtake them.
    """

    def __init__(self, message_class: type[Any], qos: QoSProfile, codec: Codec) -> None:
        """Create an empty buffer.

        Args:
            message_class: the subscription's message class.
            qos: the subscription's QoS profile; must be plain (`is_plain`).
            codec: the message class's codec.
        """
        self.message_class = message_class
        self.qos = qos
        self.dds_mark = object()
        """Replaced whenever this process may have sent the subscription a message through DDS."""
        self._empty_mark: object = None
        self.signal_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        # The buffer owns the eventfd, because publishers may signal after the handler has been
        # closed. When the process exits, workers may still be watching the eventfd, so it is not
        # closed then.
        weakref.finalize(self, os.close, self.signal_fd).atexit = False
        self.signal: Callable[[], object] = partial(os.eventfd_write, self.signal_fd, 1)
        """Writes to the eventfd."""
        self.wake: Callable[[], object] = self.signal
        """Makes the executor take waiting messages; thread-safe."""
        self._codec = codec
        self._waiting: deque[Any] = deque(maxlen=qos.depth)
        self.append: Callable[[Any], object] = self._waiting.append
        """Adds a message without a wake-up; only for the thread that takes the messages out."""

    @property
    def dds_may_hold_messages(self) -> bool:
        """Whether DDS may hold messages that later ones must not overtake."""
        return self._empty_mark is not self.dds_mark

    def mark_dds(self) -> None:
        """Record that DDS may have received a message."""
        self.dds_mark = object()

    def mark_dds_empty(self, mark: object) -> None:
        """Record that DDS was found empty at a time when `dds_mark` was `mark`."""
        self._empty_mark = mark

    def put(self, message: Any) -> None:
        """Add a message or its serialized bytes.

        No other code may hold a reference to the message.
        """
        self._waiting.append(message)
        self.wake()

    def take(self) -> tuple[Any, Any] | None:
        """Take the oldest message with its info in rclpy's form; None if the buffer is empty."""
        if not self._waiting:  # checked after every message; an exception costs ten times as much
            return None
        try:
            message = self._waiting.popleft()
        except IndexError:  # taken by another worker
            return None
        if isinstance(message, bytes):
            message = self._codec.unpack(message)
        return message, _INFO


class IntraProcessTopic:
    """The open buffers of a topic.

    A buffer is open while an executor's handler takes messages from it. As long as it is open, DDS
    matches the subscription with every compatible publisher of its context: the subscription is
    older than the buffer, and its handle is held until the buffer is closed.
    """

    def __init__(self) -> None:
        self.buffers: tuple[MessageBuffer, ...] = ()
        """Replaced on each change, so that a change can be detected by identity."""
        self._changing = threading.Lock()

    def open(self, buffer: MessageBuffer) -> None:
        """Let publishers use a buffer."""
        with self._changing:
            self.buffers = (*self.buffers, buffer)

    def close(self, buffer: MessageBuffer) -> None:
        """Stop publishers from using a buffer; a `publish` in progress may still use it."""
        with self._changing:
            self.buffers = tuple(other for other in self.buffers if other is not buffer)


_topics: weakref.WeakKeyDictionary[Context, dict[str, IntraProcessTopic]] = (
    weakref.WeakKeyDictionary()
)
_buffers: weakref.WeakKeyDictionary[Subscription, MessageBuffer] = weakref.WeakKeyDictionary()
_making = threading.Lock()


def intra_process_topic(context: Context, name: str) -> IntraProcessTopic:
    """Return a context's topic with this full name; there is one for each name."""
    with _making:
        return _topics.setdefault(context, {}).setdefault(name, IntraProcessTopic())


def buffer_of(subscription: Subscription) -> MessageBuffer | None:
    """Return the buffer of a subscription; None if it takes everything from DDS.

    A subscription does so if it requests raw bytes, a `MessageInfo`, or QoS that only DDS provides.
    """
    message_class: Any = subscription.msg_type
    codec = codec_for(message_class)
    if (
        codec is None
        or subscription.raw
        or subscription._callback_type is not Subscription.CallbackType.MessageOnly
        or not is_plain(subscription.qos_profile)
        or not middleware_is_known()
    ):
        return None
    with _making:
        if subscription not in _buffers:
            _buffers[subscription] = MessageBuffer(message_class, subscription.qos_profile, codec)
        return _buffers[subscription]


def disconnect_all(publishers: Iterable[Publisher]) -> None:
    """Prepare publishers for their destruction: a subscription that does not read delays it once.

    Without this, each of them would wait for such a subscription.
    """
    end_s = time.monotonic() + _LINGER_S
    for publisher in publishers:
        if isinstance(publisher, IntraProcessPublisher):
            publisher.disconnect(end_s)


class IntraProcessPublisher(LifecyclePublisher):
    """Puts messages into the matching buffers, or sends them to all subscriptions through DDS."""

    def __init__(self, context: Context, *args: Any, **kwargs: Any) -> None:
        """Create a publisher.

        Args:
            context: the node's context.
            args: passed to `rclpy.publisher.Publisher`.
            kwargs: passed to `rclpy.publisher.Publisher`.
        """
        super().__init__(*args, **kwargs)
        self._message_class: Any = self.msg_type
        codec = codec_for(self._message_class)
        may_bypass_dds = codec is not None and is_plain(self.qos_profile) and middleware_is_known()
        self._copy = None if codec is None else codec.copy
        self._pack = None if codec is None else codec.pack
        # An unregistered topic stays empty, so everything is sent through DDS.
        self._topic = (
            intra_process_topic(context, self.topic_name) if may_bypass_dds else IntraProcessTopic()
        )
        self._match: tuple[tuple[MessageBuffer, ...], tuple[MessageBuffer, ...]] = ((), ())
        """The open buffers at the last check, and the matching ones among them."""
        # rclpy's own methods spend a few microseconds keeping the handle alive. The
        # handle's own methods raise an exception if it was destroyed.
        self._count = self.handle.get_subscription_count
        self._may_bypass_dds = may_bypass_dds
        self._sender: LocalSender | None = None
        self._send_bytes: Callable[[bytes], None] | None = self.handle.publish_raw

    def attach(self, node: Node) -> None:
        """Also bypass DDS for subscriptions in other processes of the run.

        Args:
            node: the publisher's node.
        """
        folder = socket_folder()
        if folder is not None and self._may_bypass_dds:
            self._sender = LocalSender(
                folder,
                node_handle=node.handle,
                handle=self.handle,
                topic=self.topic_name,
                type_name=message_name(self._message_class),
                qos=self.qos_profile,
            )

    def publish(self, msg: Any) -> None:
        """Send a message, or the bytes of a serialized one, if the publisher is enabled.

        Raises:
            TypeError: `msg` is neither a message of the publisher's type nor `bytes`.
            ObeliskMsgError: a field has a value that its type cannot hold.
        """
        if not self._enabled:
            return
        sender = self._sender
        if sender is None:
            self._publish(msg, None)
        else:
            with sender.lock:
                # `disconnect` may have run while this thread waited for the lock.
                self._publish(msg, self._sender)

    def _publish(self, msg: Any, sender: LocalSender | None) -> None:
        buffers = self._topic.buffers
        seen, matched = self._match
        if seen is not buffers:
            matched = self._find_matches(buffers)
        if (
            (matched or sender is not None)
            and (
                self._count() == len(matched)
                if sender is None
                else sender.covers(self._count(), len(matched))
            )
            # Otherwise the count may include a new subscription that replaced a destroyed one.
            and self._topic.buffers is buffers
            and self._deliver_locally(msg, matched, sender)
        ):
            return
        if sender is None:
            self._send(msg)
        else:
            sender.send_through_dds(partial(self._send, msg))
        if self._topic.buffers is not buffers:
            matched = self._find_matches(self._topic.buffers)
        for buffer in matched:
            buffer.mark_dds()

    def destroy(self) -> None:
        """Destroy the publisher; for `Node.destroy_publisher`."""
        self._topic = IntraProcessTopic()
        self._send_bytes = None
        self.disconnect(time.monotonic() + _LINGER_S)
        super().destroy()

    def disconnect(self, end_s: float) -> None:
        """Use DDS from now on.

        Args:
            end_s: until when to wait for subscriptions that do not read their messages, in the time
                of `time.monotonic` [s].
        """
        sender = self._sender
        if sender is not None:
            with sender.lock:
                self._sender = None
                sender.close(end_s)

    def _send(self, message: Any) -> None:
        """Send to all subscriptions through DDS."""
        if self._pack is not None and isinstance(message, self._message_class):
            message = self._pack(message)
        if isinstance(message, bytes) and self._send_bytes is not None:
            self._send_bytes(message)
        else:
            Publisher.publish(self, message)  # raises an exception with the reason

    def _find_matches(self, buffers: tuple[MessageBuffer, ...]) -> tuple[MessageBuffer, ...]:
        """Return the buffers whose subscriptions DDS matches with this publisher."""
        matched = tuple(
            buffer
            for buffer in buffers
            if buffer.message_class is self._message_class
            and is_compatible(self.qos_profile, buffer.qos)
        )
        self._match = (buffers, matched)
        return matched

    def _deliver_locally(
        self, message: Any, buffers: tuple[MessageBuffer, ...], sender: LocalSender | None
    ) -> bool:
        """Give each buffer its own copy; false if DDS must deliver."""
        for buffer in buffers:
            if buffer.dds_may_hold_messages:
                return False
        is_message = isinstance(message, self._message_class)
        if sender is not None and sender.peers:
            if is_message:
                assert self._pack is not None
                message, is_message = self._pack(message), False
            if not (isinstance(message, bytes) and sender.send(message)):
                return False
        if is_message:
            assert self._copy is not None
            for buffer in buffers:
                buffer.put(self._copy(message))
        elif isinstance(message, bytes):
            for buffer in buffers:
                buffer.put(message)
        else:
            return False
        return True
