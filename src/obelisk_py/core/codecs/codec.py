"""The codec of a message class: to bytes, from bytes, and the copy that a round trip gives.

In place of the conversion through C structs that rclpy's messages go through, which looks classes
up by name and runs the constructors of all messages within them. Bytes that are not little-endian
CDR are left to rclpy.
"""

import functools
import reprlib
import struct
import sys
from collections.abc import Iterable, Iterator
from operator import attrgetter
from typing import Any, Final

from rclpy.serialization import deserialize_message

from obelisk_py.core.codecs.kinds import FORMATS, numbers
from obelisk_py.core.codecs.layout import Layout, Part, UnsupportedError, layout_of
from obelisk_py.core.codecs.wire import HEAD, REFUSALS, Kind
from obelisk_py.core.exceptions import ObeliskMsgError
from obelisk_py.core.messages import message_name

__all__ = ["Codec", "codec_for"]

_LITTLE_ENDIAN: Final = b"\0\1"
_HEAD: Final = _LITTLE_ENDIAN + b"\0\0"


class Codec:
    """Packs, unpacks and copies messages of one class; several threads may use it."""

    def __init__(self, message_class: type[Any], layout: Layout) -> None:
        self._class = message_class
        self._parts = layout.parts
        self._build = layout.build
        self._writes = tuple((part.kind.write, part.get) for part in layout.parts)
        self._reads = tuple(part.kind.read for part in layout.parts)
        self._copies = tuple((part.kind.copy, part.get) for part in layout.parts)

    def pack(self, message: Any) -> bytes:
        """The message as it goes over the wire.

        Raises:
            ObeliskMsgError: a field holds what its type cannot.
        """
        out = bytearray(_HEAD)
        try:
            for write, get in self._writes:
                write(out, get(message))
        except REFUSALS as error:
            raise self._refused(message) from error
        return bytes(out)

    def unpack(self, data: bytes) -> Any:
        """The message of these bytes.

        Raises:
            ObeliskMsgError: they are no message of the class.
        """
        if not data.startswith(_LITTLE_ENDIAN):
            return self._unpack_other(data)
        values: list[Any] = []
        at = HEAD
        try:
            for read in self._reads:
                at = read(data, at, values)
        except REFUSALS as error:
            raise self._unreadable(data) from error
        return self._build(values)

    def copy(self, message: Any) -> Any:
        """What `unpack(pack(message))` gives: a message that shares nothing that can change.

        Raises:
            ObeliskMsgError: a field holds what its type cannot.
        """
        values: list[Any] = []
        try:
            for copy, get in self._copies:
                copy(get(message), values)
        except REFUSALS as error:
            raise self._refused(message) from error
        return self._build(values)

    def _unpack_other(self, data: bytes) -> Any:
        try:
            return deserialize_message(data, self._class)
        except Exception as error:
            raise ObeliskMsgError(
                f"{len(data)} bytes are no {message_name(self._class)}: {error}"
            ) from error

    def _refused(self, message: Any) -> ObeliskMsgError:
        """Says which field it is: each is tried on its own."""
        name = message_name(self._class)
        for field, spelling, kind in _fields(self._parts):
            try:
                value = attrgetter(field)(message)
            except AttributeError as error:
                return ObeliskMsgError(f"{name} has no field `{field}`: {error}")
            try:
                kind.write(bytearray(_HEAD), (value,) if spelling in FORMATS else value)
            except REFUSALS as error:
                return ObeliskMsgError(
                    f"the field `{field}` of {name} is {reprlib.repr(value)}, "
                    f"expected {spelling}: {error}"
                )
        return ObeliskMsgError(f"{name} cannot be packed: it changed meanwhile")

    def _unreadable(self, data: bytes) -> ObeliskMsgError:
        beginning = f"{len(data)} bytes are no {message_name(self._class)}"
        at = HEAD
        for part in self._parts:
            field = part.fields[-1] if part.fields else "its only byte"
            try:
                at = part.kind.read(data, at, [])
            except struct.error:
                return ObeliskMsgError(f"{beginning}: they end before `{field}` does")
            except REFUSALS as error:
                return ObeliskMsgError(f"{beginning}: at `{field}`, {error}")
        return ObeliskMsgError(beginning)


def _fields(parts: Iterable[Part]) -> Iterator[tuple[str, str, Kind]]:
    """Each field with its type and a kind for it alone."""
    for part in parts:
        for field, spelling in zip(part.fields, part.types, strict=True):
            alone = numbers([FORMATS[spelling]]) if spelling in FORMATS else part.kind
            yield field, spelling, alone


@functools.cache
def codec_for(message_class: type[Any]) -> Codec | None:
    """The codec of a message class; None where it has fields that are not supported (`wstring`)."""
    if sys.byteorder != "little":
        return None
    try:
        return Codec(message_class, layout_of(message_class))
    except UnsupportedError:
        return None
