"""The messages that wait for one subscription without having gone through DDS.

Messages come in from any thread, and go out on those that run the subscription. It also knows
whether DDS may hold something from the same publishers, so that nothing overtakes it.
"""

import os
import weakref
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any, Final

from rclpy.qos import QoSProfile

from obelisk_py.core.serialization.codec import Codec

__all__ = ["Inbox"]

_INFO: Final = {
    "source_timestamp": 0,
    "received_timestamp": 0,
    "publication_sequence_number": None,
    "reception_sequence_number": None,
}
"""Nothing: who wants infos takes from DDS, unless the callback was replaced meanwhile."""


class Inbox:
    """A queue as deep as the subscription's history, and the eventfd that says that it has some."""

    def __init__(self, message_class: type[Any], qos: QoSProfile, codec: Codec) -> None:
        """Make an empty inbox.

        Args:
            message_class: of the subscription.
            qos: of the subscription; plain.
            codec: of the message class.
        """
        self.message_class = message_class
        self.qos = qos
        self.dds_mark = object()
        """Another one as often as DDS may have got something for it from this process."""
        self._empty_mark: object = None
        self.signal_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        # Publishers signal until they let go of the inbox, which may be later than its runner does.
        # At the end of the process lanes may still watch it.
        weakref.finalize(self, os.close, self.signal_fd).atexit = False
        self.signal: Callable[[], object] = partial(os.eventfd_write, self.signal_fd, 1)
        """Writes to the eventfd."""
        self.wake: Callable[[], object] = self.signal
        """Has whoever runs the subscription take what waits; called from any thread."""
        self._codec = codec
        self._waiting: deque[Any] = deque(maxlen=qos.depth)

    @property
    def waits_in_dds(self) -> bool:
        """Whether DDS may hold something that nothing may overtake."""
        return self._empty_mark is not self.dds_mark

    def mark_dds(self) -> None:
        """DDS may have got something by now."""
        self.dds_mark = object()

    def mark_dds_empty(self, mark: object) -> None:
        """DDS held nothing any more, after `dds_mark` had been `mark`."""
        self._empty_mark = mark

    def put(self, message: Any) -> None:
        """Hand over a message that nobody else has, or its bytes."""
        self._waiting.append(message)
        self.wake()

    def take(self) -> tuple[Any, Any] | None:
        """The oldest message and what is known of it, as rclpy gives them; None if none waits."""
        if not self._waiting:  # as after every message; an exception costs ten times as much
            return None
        try:
            message = self._waiting.popleft()
        except IndexError:  # taken by another lane
            return None
        if isinstance(message, bytes):
            message = self._codec.unpack(message)
        return message, _INFO
