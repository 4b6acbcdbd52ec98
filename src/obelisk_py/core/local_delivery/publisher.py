"""`LocalPublisher`: a life-cycle publisher that leaves DDS out where only this process listens."""

from collections.abc import Callable
from typing import Any

from rclpy.context import Context
from rclpy.lifecycle.publisher import LifecyclePublisher
from rclpy.publisher import Publisher

from obelisk_py.core.local_delivery.exchange import LocalTopic, local_topic
from obelisk_py.core.local_delivery.inbox import Inbox
from obelisk_py.core.local_delivery.matching import is_compatible, is_plain, middleware_is_known
from obelisk_py.core.serialization.codec import codec_for

__all__ = ["LocalPublisher"]


class LocalPublisher(LifecyclePublisher):
    """Hands messages to the inboxes that match, or sends them by DDS to all."""

    def __init__(self, context: Context, *args: Any, **kwargs: Any) -> None:
        """Make a publisher.

        Args:
            context: of its node.
            args: of `rclpy.publisher.Publisher`.
            kwargs: of `rclpy.publisher.Publisher`.
        """
        super().__init__(*args, **kwargs)
        self._message_class: Any = self.msg_type
        codec = codec_for(self._message_class)
        may_be_local = codec is not None and is_plain(self.qos_profile) and middleware_is_known()
        self._copy = None if codec is None else codec.copy
        self._pack = None if codec is None else codec.pack
        # One that nobody else knows stays empty: everything goes by DDS.
        self._local_topic = local_topic(context, self.topic_name) if may_be_local else LocalTopic()
        self._match: tuple[tuple[Inbox, ...], tuple[Inbox, ...]] = ((), ())
        """The open inboxes when they were last looked at, and those of them that match."""
        # Those of rclpy take some microseconds for keeping the handle from being destroyed; these
        # raise if it is.
        self._count = self.handle.get_subscription_count
        self._send_bytes: Callable[[bytes], None] | None = self.handle.publish_raw

    def publish(self, msg: Any) -> None:
        """Send a message, or the bytes of a packed one, if the publisher is enabled.

        Raises:
            TypeError: it is neither.
            ObeliskMsgError: a field holds what its type cannot.
        """
        if not self._enabled:
            return
        inboxes = self._local_topic.inboxes
        seen, matched = self._match
        if seen is not inboxes:
            matched = self._look_at(inboxes)
        if (
            matched
            and self._count() == len(matched)
            # Else one that has just gone may have been counted as another one that has just come.
            and self._local_topic.inboxes is inboxes
            and self._hand_over(msg, matched)
        ):
            return
        self._send(msg)
        if self._local_topic.inboxes is not inboxes:
            matched = self._look_at(self._local_topic.inboxes)
        for inbox in matched:
            inbox.mark_dds()

    def destroy(self) -> None:
        """Destroy the publisher; for `Node.destroy_publisher`."""
        self._local_topic = LocalTopic()
        self._send_bytes = None
        super().destroy()

    def _send(self, message: Any) -> None:
        """Send by DDS to all."""
        if self._pack is not None and isinstance(message, self._message_class):
            message = self._pack(message)
        if isinstance(message, bytes) and self._send_bytes is not None:
            self._send_bytes(message)
        else:
            Publisher.publish(self, message)  # says what is wrong

    def _look_at(self, inboxes: tuple[Inbox, ...]) -> tuple[Inbox, ...]:
        """Those that DDS matches with this publisher."""
        matched = tuple(
            inbox
            for inbox in inboxes
            if inbox.message_class is self._message_class
            and is_compatible(self.qos_profile, inbox.qos)
        )
        self._match = (inboxes, matched)
        return matched

    def _hand_over(self, message: Any, inboxes: tuple[Inbox, ...]) -> bool:
        """Give each inbox a copy of its own; false if that is DDS's to do."""
        for inbox in inboxes:
            if inbox.waits_in_dds:
                return False
        if isinstance(message, self._message_class):
            assert self._copy is not None
            for inbox in inboxes:
                inbox.put(self._copy(message))
        elif isinstance(message, bytes):
            for inbox in inboxes:
                inbox.put(message)
        else:
            return False
        return True
