"""Which subscriptions of this process take messages past DDS: by context and resolved topic.

A subscription is open while a runner of `EventLoopExecutor` listens to it. Then it is matched in
DDS with every publisher of its context that fits: it was made before it is opened, and its handle
is held until it is closed.
"""

import threading
import weakref
from typing import Any

from rclpy.context import Context
from rclpy.subscription import Subscription

from obelisk_py.core.local_delivery.inbox import Inbox
from obelisk_py.core.local_delivery.matching import is_plain, middleware_is_known
from obelisk_py.core.serialization.codec import codec_for

__all__ = ["LocalTopic", "inbox_of", "local_topic"]


class LocalTopic:
    """The open inboxes of a topic."""

    def __init__(self) -> None:
        self.inboxes: tuple[Inbox, ...] = ()
        """Another tuple after each change, so that a change can be told by identity."""
        self._changing = threading.Lock()

    def open(self, inbox: Inbox) -> None:
        """Let publishers hand messages to it from now on."""
        with self._changing:
            self.inboxes = (*self.inboxes, inbox)

    def close(self, inbox: Inbox) -> None:
        """Let them no longer; those that are about to may still do it."""
        with self._changing:
            self.inboxes = tuple(other for other in self.inboxes if other is not inbox)


_topics: weakref.WeakKeyDictionary[Context, dict[str, LocalTopic]] = weakref.WeakKeyDictionary()
_inboxes: weakref.WeakKeyDictionary[Subscription, Inbox] = weakref.WeakKeyDictionary()
_making = threading.Lock()


def local_topic(context: Context, name: str) -> LocalTopic:
    """The one topic of this full name in a context."""
    with _making:
        return _topics.setdefault(context, {}).setdefault(name, LocalTopic())


def inbox_of(subscription: Subscription) -> Inbox | None:
    """The one inbox of a subscription; None where it takes everything from DDS.

    That is where it wants bytes or message infos, or a quality of service that only DDS has.
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
        if subscription not in _inboxes:
            _inboxes[subscription] = Inbox(message_class, subscription.qos_profile, codec)
        return _inboxes[subscription]
