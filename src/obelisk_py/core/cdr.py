"""A message in the form that goes over the wire, with numbers that are changed in place.

In: a message whose strings and lengths are final. Out: its bytes, which a publisher takes as they
are, and views of the numbers in them. A message that is published over and over is packed once:
what stays is never touched again, and nothing is converted. The bytes are rclpy's own; here is only
found where in them each field is.

Source: OMG DDS-XTypes 1.3, 7.4 (XCDR version 1): a number stands at a multiple of its size, counted
from the end of the four bytes that say how the rest is written.
"""

import re
import struct
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import serialize_message

from obelisk_py.core.exceptions import ObeliskMsgError

__all__ = ["PackedMessage"]

_HEAD: Final = 4
"""Bytes that say how the rest is written."""
_ALIGNMENT: Final = 8
_NUMBERS: Final = {
    "boolean": "?",
    "octet": "u1",
    "uint8": "u1",
    "int8": "i1",
    "uint16": "u2",
    "int16": "i2",
    "uint32": "u4",
    "int32": "i4",
    "uint64": "u8",
    "int64": "i8",
    "float": "f4",
    "double": "f8",
}
_LENGTH: Final = np.dtype("u4")
_ARRAY: Final = re.compile(r"(?P<element>.+)\[\d+\]")
_SEQUENCE: Final = re.compile(r"sequence<(?P<element>.+?)(, \d+)?>")
_STRING: Final = re.compile(r"string(<\d+>)?")
_TIME: Final = "builtin_interfaces/Time"
_STAMP: Final = struct.Struct("=iI")
_NS_PER_S: Final = 1_000_000_000


class _Place(NamedTuple):
    """Where the numbers of a field are."""

    field: str
    """`header.stamp.sec`, `joint_pos`, `markers.2.scale.x`."""
    start: int
    """Bytes from the head."""
    dtype: np.dtype[Any]
    size: int
    """How many numbers."""

    @property
    def end(self) -> int:
        return self.start + self.size * self.dtype.itemsize


class PackedMessage:
    """The bytes of one message."""

    def __init__(self, message: Any) -> None:
        """Pack a message.

        Raises:
            ObeliskMsgError: it has fields of a kind that is not supported (`wstring`).
        """
        layout = _Layout()
        layout.take_message(message, "")
        written = np.frombuffer(serialize_message(message), np.uint8)
        # Aligned in memory as in the message: what is behind the head begins where a double may.
        self._data = np.zeros(_ALIGNMENT + layout.end, np.uint8)[_ALIGNMENT - _HEAD :]
        # Between the fields and behind the last one rclpy leaves what it finds.
        for start, end in ((-_HEAD, 0), *layout.spans):
            self._data[_HEAD + start : _HEAD + end] = written[_HEAD + start : _HEAD + end]
        self._bytes = self._data.data
        self._places = layout.places
        self._stamps = tuple(place + _HEAD for place in layout.stamps)

    @property
    def fields(self) -> tuple[str, ...]:
        """The fields that hold numbers, in the message's order."""
        return tuple(place.field for place in self._places)

    def numbers(self, field: str) -> NDArray[Any]:
        """A field's numbers in the message's own memory, shape `(n,)`.

        Args:
            field: `joint_pos`, `pose.position` (x, y, z), `markers.2.scale`.

        Raises:
            KeyError: the message has no such numbers, or they are not all of one type.
        """
        inner = f"{field}."
        places = [p for p in self._places if p.field == field or p.field.startswith(inner)]
        are_one = all(
            one.end == next_one.start and one.dtype == next_one.dtype
            for one, next_one in pairwise(places)
        )
        if not places or not are_one:
            raise KeyError(field)
        return self._data[_HEAD + places[0].start : _HEAD + places[-1].end].view(places[0].dtype)

    def to_bytes(self, stamp_ns: int) -> bytes:
        """The message as it is now; each `builtin_interfaces/Time` in it is `stamp_ns` [ns]."""
        seconds, nanoseconds = divmod(stamp_ns, _NS_PER_S)
        for place in self._stamps:
            _STAMP.pack_into(self._bytes, place, seconds, nanoseconds)
        return self._bytes.tobytes()


class _Layout:
    """Goes through a message field by field and counts bytes."""

    def __init__(self) -> None:
        self.end = 0
        self.spans: list[tuple[int, int]] = []
        """What is no filling: first byte, byte behind the last."""
        self.places: list[_Place] = []
        self.stamps: list[int] = []

    def take_message(self, message: Any, prefix: str) -> None:
        fields = message.get_fields_and_field_types()
        if not fields:
            # The wire knows no message without members.
            self._skip(1)
        for name, kind in fields.items():
            self._take(kind, getattr(message, name), prefix + name)

    def _take(self, kind: str, value: Any, field: str) -> None:
        if array := _ARRAY.fullmatch(kind):
            self._take_all(array["element"], value, field)
        elif sequence := _SEQUENCE.fullmatch(kind):
            self._skip_length()
            self._take_all(sequence["element"], value, field)
        elif _STRING.fullmatch(kind):
            self._skip_length()
            self._skip(len(value.encode()) + 1)
        elif kind in _NUMBERS:
            self._place(kind, 1, field)
        elif kind.startswith("wstring"):
            raise ObeliskMsgError(f"the field `{field}` is a {kind}, which cannot be packed")
        else:
            if kind == _TIME:
                self._align(_LENGTH)
                self.stamps.append(self.end)
            self.take_message(value, f"{field}.")

    def _take_all(self, kind: str, values: Sequence[Any], field: str) -> None:
        if kind not in _NUMBERS:
            for number, value in enumerate(values):
                self._take(kind, value, f"{field}.{number}")
        elif len(values):
            self._place(kind, len(values), field)

    def _place(self, kind: str, count: int, field: str) -> None:
        dtype = np.dtype(_NUMBERS[kind])
        self._align(dtype)
        self.places.append(_Place(field, self.end, dtype, count))
        self._skip(count * dtype.itemsize)

    def _skip_length(self) -> None:
        self._align(_LENGTH)
        self._skip(_LENGTH.itemsize)

    def _align(self, dtype: np.dtype[Any]) -> None:
        self.end += -self.end % dtype.itemsize

    def _skip(self, count: int) -> None:
        self.spans.append((self.end, self.end + count))
        self.end += count
