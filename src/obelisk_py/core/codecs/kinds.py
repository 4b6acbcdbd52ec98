"""What a field of a message can hold, and how each kind stands on the wire.

A kind writes a value behind the bytes that are there, reads one and says where the next field
begins, and gives the value that a reader of the written bytes would get. It is three functions and
what they know, because this is what a loop at 1 kHz spends its time on. Positions are counted from
the beginning of the message, four bytes before the first field.

Values go by rclpy's rules: `array.array` for sequences of numbers, numpy arrays for arrays of them,
one `bytes` for an octet, lists for the rest. What a type cannot hold raises one of `REFUSALS`; what
rclpy would take for something else, an int in a float field, is converted.

Source: OMG DDS-XTypes 1.3, 7.4 (XCDR version 1): a number stands at a multiple of its size.
"""

import functools
import struct
from array import array
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.codecs.wire import CUT_OFF, GAPS, HEAD, LENGTH, UNLIMITED, Kind, need, too_many

__all__ = [
    "FORMATS",
    "filler",
    "flag",
    "numbers",
    "numbers_array",
    "numbers_sequence",
    "octet",
    "text",
]

FORMATS: Final = {
    "octet": "c",
    "uint8": "B",
    "int8": "b",
    "uint16": "H",
    "int16": "h",
    "uint32": "I",
    "int32": "i",
    "uint64": "Q",
    "int64": "q",
    "float": "f",
    "double": "d",
}
"""Of each type of numbers the letter, in `struct` as in `array`."""

_ALIGNMENT: Final = 8
_OCTET: Final = struct.Struct("c")
_AROUND_TEXT: Final = 5
"""Its length, and the NUL at its end [bytes]."""
_SHORT: Final = 256
_MANY: Final = 1024
_TRUTHS: Final = {b"\0": False, b"\1": True}


def numbers(formats: Sequence[str]) -> Kind:
    """Numbers that follow one another, whatever messages they are in; the value is a tuple."""
    # By the position modulo eight, so that filling costs nothing.
    layouts = tuple(_aligned(formats, at) for at in range(_ALIGNMENT))
    pack, unpack = layouts[HEAD].pack, layouts[HEAD].unpack

    def write(out: bytearray, value: Any) -> None:
        out += layouts[len(out) & 7].pack(*value)

    def read(data: bytes, at: int, values: list[Any]) -> int:
        layout = layouts[at & 7]
        values += layout.unpack_from(data, at)
        return at + layout.size

    def copy(value: Any, values: list[Any]) -> None:
        values += unpack(pack(*value))

    return Kind(write, read, copy)


def flag() -> Kind:
    """A boolean."""

    def write(out: bytearray, value: Any) -> None:
        out.append(_truth(value))

    def read(data: bytes, at: int, values: list[Any]) -> int:
        try:
            values.append(_TRUTHS[data[at : at + 1]])
        except KeyError:
            raise ValueError("neither false nor true") from None
        return at + 1

    def copy(value: Any, values: list[Any]) -> None:
        values.append(_truth(value))

    return Kind(write, read, copy)


def octet() -> Kind:
    """A byte in a list; one of its own is among `numbers`."""

    def write(out: bytearray, value: Any) -> None:
        out += _OCTET.pack(value)

    def read(data: bytes, at: int, values: list[Any]) -> int:
        values += _OCTET.unpack_from(data, at)
        return at + 1

    def copy(value: Any, values: list[Any]) -> None:
        values += _OCTET.unpack(_OCTET.pack(value))

    return Kind(write, read, copy)


def filler() -> Kind:
    """The byte that stands for a message without fields."""

    def write(out: bytearray, _value: Any) -> None:
        out.append(0)

    def read(data: bytes, at: int, _values: list[Any]) -> int:
        need(data, at + 1)
        return at + 1

    def copy(_value: Any, _values: list[Any]) -> None:
        pass

    return Kind(write, read, copy)


def text(limit: int = UNLIMITED) -> Kind:
    """A string of at most `limit` bytes."""

    def write(out: bytearray, value: Any) -> None:
        written = written_text(value) if len(value) < _SHORT else _write_text(value)
        if len(written) > limit + _AROUND_TEXT:
            raise too_many(len(written) - _AROUND_TEXT, limit)
        place = len(out) & 3
        if place:
            out += GAPS[place]
        out += written

    def read(data: bytes, at: int, values: list[Any]) -> int:
        at = (at + 3) & -4
        length: int = unpack_length(data, at)[0]
        at += 4
        end = at + length
        content = data[at:end]
        if len(content) != length:
            raise ValueError(CUT_OFF)
        if length > limit + 1:
            raise too_many(length - 1, limit)
        values.append(read_text(content) if length < _SHORT else _read_text(content))
        return end

    def copy(value: Any, values: list[Any]) -> None:
        written = written_text(value) if len(value) < _SHORT else _write_text(value)
        if len(written) > limit + _AROUND_TEXT:
            raise too_many(len(written) - _AROUND_TEXT, limit)
        values.append(value if "\0" not in value else value.partition("\0")[0])

    # Most are the names of frames and joints, the same each time.
    written_text = functools.lru_cache(_MANY)(_write_text)
    read_text = functools.lru_cache(_MANY)(_read_text)
    unpack_length = LENGTH.unpack_from
    return Kind(write, read, copy)


def numbers_sequence(code: str, limit: int = UNLIMITED) -> Kind:
    """A sequence of at most `limit` numbers, an `array.array`."""
    empty = array(code)
    size = empty.itemsize
    # A length and, before a first number, the filling up to it; by the position modulo eight.
    heads = tuple(_counting(size, at) for at in range(_ALIGNMENT))
    heads_of_empty = tuple(struct.pack(f"<{-at % 4}xI", 0) for at in range(4))
    unpack_length = LENGTH.unpack_from

    def checked(value: Any) -> Any:
        if type(value) is not array or value.typecode != code:
            value = _as_array(code, value)
        if len(value) > limit:
            raise too_many(len(value), limit)
        return value

    def write(out: bytearray, value: Any) -> None:
        found = checked(value)
        count = len(found)
        if count:
            out += heads[len(out) & 7](count)
            out += found
        else:
            out += heads_of_empty[len(out) & 3]

    def read(data: bytes, at: int, values: list[Any]) -> int:
        at = (at + 3) & -4
        count: int = unpack_length(data, at)[0]
        at += 4
        found = empty[:]
        values.append(found)
        if not count:
            return at
        if count > limit:
            raise too_many(count, limit)
        if size > HEAD:
            at = ((at + 3) & -8) + HEAD
        end = at + count * size
        found.frombytes(data[at:end])
        if len(found) != count:
            raise ValueError(CUT_OFF)
        return end

    def copy(value: Any, values: list[Any]) -> None:
        values.append(checked(value)[:])

    return Kind(write, read, copy)


def numbers_array(code: str, count: int) -> Kind:
    """An array of numbers, a numpy array of shape `(count,)`."""
    dtype = np.dtype(code)
    size = dtype.itemsize

    def checked(value: Any) -> NDArray[Any]:
        if type(value) is not np.ndarray or value.dtype != dtype:
            value = np.array(value).astype(dtype, casting="safe")
        if value.shape != (count,):
            raise ValueError(f"its shape is {value.shape}, expected ({count},)")
        return value  # type: ignore[no-any-return]

    def write(out: bytearray, value: Any) -> None:
        found = checked(value)
        out += bytes(-(len(out) - HEAD) % size)
        out += found.tobytes()

    def read(data: bytes, at: int, values: list[Any]) -> int:
        at += -(at - HEAD) % size
        end = at + count * size
        need(data, end)
        values.append(np.frombuffer(data, dtype, count, at).copy())
        return end

    def copy(value: Any, values: list[Any]) -> None:
        values.append(checked(value).copy())

    return Kind(write, read, copy)


def _aligned(formats: Sequence[str], at: int) -> struct.Struct:
    """The layout of numbers from a position (modulo eight) on, with the filling that they need."""
    parts, place = ["<"], at - HEAD
    for code in formats:
        size = struct.calcsize(f"<{code}")
        gap = -place % size
        parts.append(f"{gap}x{code}")
        place += gap + size
    return struct.Struct("".join(parts))


def _counting(size: int, at: int) -> Callable[[int], bytes]:
    """Writes a length at a position (modulo eight), and the filling before numbers of that size."""
    gap = -at % 4
    return struct.Struct(f"<{gap}xI{-(at + gap) % size}x").pack


def _truth(value: Any) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise TypeError("it is no boolean")
    return bool(value)


def _as_array(code: str, value: Any) -> Any:
    if isinstance(value, str | bytes | bytearray):
        raise TypeError("it is no sequence of numbers")
    return array(code, value)


def _write_text(value: Any) -> bytes:
    """A string with its length; it ends where C lets it end, at the first NUL."""
    if not isinstance(value, str):
        raise TypeError("it is no string")
    content = value.encode().partition(b"\0")[0]
    return LENGTH.pack(len(content) + 1) + content + b"\0"


def _read_text(content: bytes) -> str:
    return content.partition(b"\0")[0].decode(errors="replace")
