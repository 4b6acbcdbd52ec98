"""The codec of a message class: to bytes, from bytes, and the copy that a round trip gives."""

import functools
from typing import Any

from rclpy.serialization import deserialize_message, serialize_message

__all__ = ["Codec", "codec_for"]


class Codec:
    """Packs, unpacks and copies messages of one class."""

    def __init__(self, message_class: type[Any]) -> None:
        self._class = message_class

    def pack(self, message: Any) -> bytes:
        """The message as it goes over the wire.

        Raises:
            ObeliskMsgError: a field holds what its type cannot.
        """
        return bytes(serialize_message(message))

    def unpack(self, data: bytes) -> Any:
        """The message of these bytes.

        Raises:
            ObeliskMsgError: they are no message of the class.
        """
        return deserialize_message(data, self._class)

    def copy(self, message: Any) -> Any:
        """What `unpack(pack(message))` gives: a message that shares nothing that can change.

        Raises:
            ObeliskMsgError: a field holds what its type cannot.
        """
        return self.unpack(self.pack(message))


@functools.cache
def codec_for(message_class: type[Any]) -> Codec | None:
    """The codec of a message class; None where it has fields that are not supported (`wstring`)."""
    return Codec(message_class)
