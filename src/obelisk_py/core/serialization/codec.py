"""Serialize and deserialize messages, and change numbers in serialized messages.

A codec packs, unpacks and copies messages. It replaces rclpy's conversion through C structs, which
looks up classes by name and runs the constructors of all nested messages. Bytes other than
little-endian CDR are passed to rclpy.

A `PackedMessage` is for a message that is published repeatedly with the same strings and lengths.
It is packed once, and its numbers are changed in place without any conversion.
"""

import functools
import reprlib
import struct
import sys
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from operator import attrgetter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message

from obelisk_py.core.exceptions import ObeliskMsgError
from obelisk_py.core.messages import message_name
from obelisk_py.core.serialization.cdr_types import (
    CONVERSION_ERRORS,
    FORMATS,
    HEADER_SIZE,
    numbers,
)
from obelisk_py.core.serialization.codegen import (
    CdrType,
    Functions,
    NumberField,
    functions_of,
)
from obelisk_py.core.serialization.layout import (
    Layout,
    Part,
    UnsupportedError,
    layout_of,
    locate_numbers,
)

__all__ = ["Codec", "PackedMessage", "codec_for"]

_LITTLE_ENDIAN: Final = b"\0\1"
_HEADER: Final = _LITTLE_ENDIAN + b"\0\0"
_ALIGNMENT: Final = 8
_pack_stamp: Final = struct.Struct("<iI").pack_into
_LENGTH: Final = struct.Struct("<I")
_NS_PER_S: Final = 1_000_000_000


class Codec:
    """Packs, unpacks and copies messages of one class; thread-safe."""

    def __init__(self, message_class: type[Any], layout: Layout) -> None:
        self._class = message_class
        self._parts = layout.parts
        self._source = layout.source

    # Compiled when first used: a publisher only writes, and most subscriptions only read.

    @functools.cached_property
    def _write(self) -> Callable[[bytearray, Any], None]:
        return self._source.compiled("write")

    @functools.cached_property
    def _read(self) -> Callable[[bytes, int], tuple[Any, int]]:
        return self._source.compiled("read")

    @functools.cached_property
    def _copy(self) -> Callable[[Any], Any]:
        return self._source.compiled("copy")

    @property
    def source(self) -> str:
        """The Python source that packs, unpacks and copies, for debugging."""
        return "\n\n".join(map(self._source.text, Functions._fields))

    def pack(self, message: Any) -> bytes:
        """Serialize a message to the wire format.

        Raises:
            ObeliskMsgError: a field has a value that its type cannot hold.
        """
        out = bytearray(_HEADER)
        try:
            self._write(out, message)
        except CONVERSION_ERRORS as error:
            raise self._pack_error(message) from error
        return bytes(out)

    def unpack(self, data: bytes) -> Any:
        """Deserialize a message.

        Raises:
            ObeliskMsgError: the bytes are not a message of this class.
        """
        if not data.startswith(_LITTLE_ENDIAN):
            return self._unpack_other(data)
        try:
            return self._read(data, HEADER_SIZE)[0]
        except CONVERSION_ERRORS as error:
            raise self._unpack_error(data) from error

    def copy(self, message: Any) -> Any:
        """Copy a message without shared mutable data, like `unpack(pack(message))`.

        Raises:
            ObeliskMsgError: a field has a value that its type cannot hold.
        """
        try:
            return self._copy(message)
        except CONVERSION_ERRORS as error:
            raise self._pack_error(message) from error

    def locate_numbers(self, data: bytes) -> list[NumberField]:
        """Locate the numbers in a message written by `pack`, in the order of its fields."""
        found: list[NumberField] = []
        locate_numbers(self._parts, data, HEADER_SIZE, "", found)
        return found

    def _unpack_other(self, data: bytes) -> Any:
        try:
            return deserialize_message(data, self._class)
        except Exception as error:
            raise ObeliskMsgError(
                f"{len(data)} bytes are not a {message_name(self._class)}: {error}"
            ) from error

    def _pack_error(self, message: Any) -> ObeliskMsgError:
        """Name the invalid field, by packing each field separately."""
        name = message_name(self._class)
        for field, spelling, kind in _fields(self._parts):
            try:
                value = attrgetter(field)(message)
            except AttributeError as error:
                return ObeliskMsgError(f"{name} has no field `{field}`: {error}")
            try:
                functions_of(kind).write(bytearray(_HEADER), value)
            except CONVERSION_ERRORS as error:
                return ObeliskMsgError(
                    f"the field `{field}` of {name} is {reprlib.repr(value)}, "
                    f"expected {spelling}: {error}"
                )
        return ObeliskMsgError(f"{name} cannot be packed: it was changed in the meantime")

    def _unpack_error(self, data: bytes) -> ObeliskMsgError:
        beginning = f"{len(data)} bytes are not a {message_name(self._class)}"
        at = HEADER_SIZE
        for part in self._parts:
            field = part.fields[-1] if part.fields else "its only byte"
            try:
                _, at = functions_of(part.cdr_type, fields=len(part.fields)).read(data, at)
            except struct.error:
                return ObeliskMsgError(f"{beginning}: they end before `{field}` does")
            except CONVERSION_ERRORS as error:
                return ObeliskMsgError(f"{beginning}: at `{field}`, {error}")
        return ObeliskMsgError(beginning)


def _fields(parts: Iterable[Part]) -> Iterator[tuple[str, str, CdrType]]:
    """Yield each field with the name of its type and a CDR type for this field alone."""
    for part in parts:
        for field, spelling in zip(part.fields, part.types, strict=True):
            alone = numbers((FORMATS[spelling],)) if spelling in FORMATS else part.cdr_type
            yield field, spelling, alone


@functools.cache
def codec_for(message_class: type[Any]) -> Codec | None:
    """Return the codec of a message class; None if a field is not supported (`wstring`)."""
    if sys.byteorder != "little":
        return None
    try:
        return Codec(message_class, layout_of(message_class))
    except UnsupportedError:
        return None


def _why_unsupported(message_class: type[Any]) -> str:
    reason = "this machine is big-endian"
    try:
        layout_of(message_class)
    except UnsupportedError as error:
        reason = str(error)
    return f"{message_name(message_class)} cannot be packed: {reason}"


class PackedMessage:
    """The serialized bytes of a message; its strings and lengths cannot change."""

    def __init__(self, message: Any) -> None:
        """Pack a message.

        Raises:
            ObeliskMsgError: a field has an unsupported type (`wstring`), or a value that its type
                cannot hold.
        """
        message_class: Any = type(message)
        codec = codec_for(message_class)
        if codec is None:
            raise ObeliskMsgError(_why_unsupported(message_class))
        packed = codec.pack(message)
        # Aligned in memory as in the message: a double may follow the header.
        self._data = np.zeros(_ALIGNMENT + len(packed), np.uint8)[_ALIGNMENT - HEADER_SIZE :][
            : len(packed)
        ]
        self._data[:] = np.frombuffer(packed, np.uint8)
        self._bytes = self._data.data
        self._fields = tuple(codec.locate_numbers(packed))
        self._stamps = tuple(field.start for field in self._fields if field.is_stamp)

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the fields with numbers, in the message's order."""
        return tuple(field.name for field in self._fields)

    def numbers(self, name: str) -> NDArray[Any]:
        """Return a field's numbers in the message's own memory, shape `(n,)`.

        Args:
            name: such as `joint_pos`, `pose.position` (x, y, z) or `markers.2.scale`.

        Raises:
            KeyError: the message has no such numbers, or they have different types.
        """
        inner = f"{name}."
        fields = [f for f in self._fields if f.name == name or f.name.startswith(inner)]
        are_one_array = all(
            one.end == following.start and one.dtype == following.dtype
            for one, following in pairwise(fields)
        )
        if not fields or not are_one_array:
            raise KeyError(name)
        return self._data[fields[0].start : fields[-1].end].view(fields[0].dtype)

    def to_bytes(self, stamp_ns: int) -> bytes:
        """Return the current bytes, with every `builtin_interfaces/Time` set to `stamp_ns` [ns]."""
        self._set_stamps(stamp_ns)
        return self._bytes.tobytes()

    def to_bytes_with(self, stamp_ns: int, field: str, count: int) -> bytes:
        """Like `to_bytes`, but with only the first `count` elements of an array.

        Args:
            stamp_ns: the stamp [ns].
            field: name of a variable-length array; all fields after it must be single bytes.
            count: number of elements, at most as many as in the original message.
        """
        (array,) = [each for each in self._fields if each.name == field]
        self._set_stamps(stamp_ns)
        _LENGTH.pack_into(self._bytes, array.start - _LENGTH.size, count)
        end = array.start + count * array.dtype.itemsize
        return self._bytes[:end].tobytes() + self._bytes[array.end :].tobytes()

    def _set_stamps(self, stamp_ns: int) -> None:
        seconds, nanoseconds = divmod(stamp_ns, _NS_PER_S)
        for start in self._stamps:
            _pack_stamp(self._bytes, start, seconds, nanoseconds)
