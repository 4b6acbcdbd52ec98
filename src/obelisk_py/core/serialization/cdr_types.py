"""CDR types: write, read, copy and locate one field, or several consecutive fields.

Each `CdrType` is a tuple of four closures, because a loop at 1 kHz spends much of its time here.
Positions count from the start of the message, whose first four bytes are the encapsulation header.

Python types follow rclpy: `array.array` for sequences of numbers, numpy arrays for arrays of
numbers, a single `bytes` for an octet, and lists for the rest. If the type cannot hold a value, one
of `CONVERSION_ERRORS` is raised. An int in a float field is converted.

Source: OMG DDS-XTypes 1.3, 7.4 (XCDR version 1): numbers are aligned to a multiple of their size.
"""

import functools
import struct
from array import array
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "BYTE_DTYPES",
    "CONVERSION_ERRORS",
    "FORMATS",
    "HEADER_SIZE",
    "UNLIMITED",
    "CdrType",
    "NumberField",
    "empty_struct",
    "flag",
    "list_of",
    "numbers",
    "numbers_array",
    "numbers_sequence",
    "octet",
    "strings",
    "text",
]

HEADER_SIZE: Final = 4
"""Size of the encapsulation header before the first field [bytes]."""
LENGTH: Final = struct.Struct("<I")
PADDING: Final = tuple(bytes(-place % 4) for place in range(4))
"""Padding to a multiple of four, by position modulo four."""
UNLIMITED: Final = 2**32 - 1
"""Maximum length in the wire format."""
CONVERSION_ERRORS: Final = (struct.error, TypeError, ValueError, OverflowError, AttributeError)
"""Exceptions of a `CdrType`: a value does not fit its type, or the bytes are invalid."""
CUT_OFF: Final = "they end too early"


class NumberField(NamedTuple):
    """The location of one field's numbers in a serialized message."""

    name: str
    """`header.stamp.sec`, `joint_pos`, `markers.2.scale.x`."""
    start: int
    """Position of the first number."""
    dtype: np.dtype[Any]
    size: int
    """Number of numbers."""
    is_stamp: bool = False
    """Whether it is the `sec` of a `builtin_interfaces/Time`."""

    @property
    def end(self) -> int:
        """Position after the last number."""
        return self.start + self.size * self.dtype.itemsize


Locate = Callable[[bytes, int, Sequence[str], list[NumberField]], int]
"""Appends the locations of the named fields' numbers; returns the position after the fields."""


class CdrType(NamedTuple):
    """The type of one field, or of several fields that are written together."""

    write: Callable[[bytearray, Any], None]
    """Appends a value and the padding before it."""
    read: Callable[[bytes, int, list[Any]], int]
    """Appends the value at a position to the list; returns the position after it."""
    copy: Callable[[Any, list[Any]], None]
    """Appends the value that reading the written value would return."""
    locate: Locate


def require(data: bytes, end: int) -> None:
    """Raise ValueError if the data is shorter than `end` bytes."""
    if end > len(data):
        raise ValueError(CUT_OFF)


def too_many(count: int, limit: int) -> ValueError:
    """Build the error for a string or sequence that exceeds the limit of its type."""
    return ValueError(f"its length is {count}, expected at most {limit}")


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
"""The type code of each number type, the same in `struct` and `array`."""

BYTE_DTYPES: Final = {"boolean": np.dtype("?"), "octet": np.dtype("B")}
"""The dtype that `locate` reports for one-byte types that are not numbers in Python."""

_ALIGNMENT: Final = 8
_OCTET: Final = struct.Struct("c")
_AROUND_TEXT: Final = 5
"""Size of a string's length and its final NUL [bytes]."""
_SHORT: Final = 256
_MANY: Final = 1024
_TRUTHS: Final = {b"\0": False, b"\1": True}


def numbers(formats: Sequence[str]) -> CdrType:
    """Consecutive numbers, even across nested messages; the value is a tuple."""
    # One layout for each position modulo eight, so that padding costs nothing.
    layouts = tuple(_aligned(formats, at) for at in range(_ALIGNMENT))
    pack, unpack = layouts[HEADER_SIZE].pack, layouts[HEADER_SIZE].unpack

    def write(out: bytearray, value: Any) -> None:
        out += layouts[len(out) & 7].pack(*value)

    def read(data: bytes, at: int, values: list[Any]) -> int:
        layout = layouts[at & 7]
        values += layout.unpack_from(data, at)
        return at + layout.size

    def copy(value: Any, values: list[Any]) -> None:
        values += unpack(pack(*value))

    def locate(_data: bytes, at: int, names: Sequence[str], found: list[NumberField]) -> int:
        for name, code in zip(names, formats, strict=True):
            dtype = _dtype(code)
            at += -(at - HEADER_SIZE) % dtype.itemsize
            found.append(NumberField(name, at, dtype, 1))
            at += dtype.itemsize
        return at

    return CdrType(write, read, copy, locate)


def flag() -> CdrType:
    """A boolean."""

    def write(out: bytearray, value: Any) -> None:
        out.append(_truth(value))

    def read(data: bytes, at: int, values: list[Any]) -> int:
        try:
            values.append(_TRUTHS[data[at : at + 1]])
        except KeyError:
            raise ValueError("it is neither false nor true") from None
        return at + 1

    def copy(value: Any, values: list[Any]) -> None:
        values.append(_truth(value))

    def locate(_data: bytes, at: int, names: Sequence[str], found: list[NumberField]) -> int:
        found.append(NumberField(names[0], at, BYTE_DTYPES["boolean"], 1))
        return at + 1

    return CdrType(write, read, copy, locate)


def octet() -> CdrType:
    """A byte in a list; `numbers` handles single octets."""

    def write(out: bytearray, value: Any) -> None:
        out += _OCTET.pack(value)

    def read(data: bytes, at: int, values: list[Any]) -> int:
        values += _OCTET.unpack_from(data, at)
        return at + 1

    def copy(value: Any, values: list[Any]) -> None:
        values += _OCTET.unpack(_OCTET.pack(value))

    def locate(_data: bytes, at: int, names: Sequence[str], found: list[NumberField]) -> int:
        found.append(NumberField(names[0], at, BYTE_DTYPES["octet"], 1))
        return at + 1

    return CdrType(write, read, copy, locate)


def empty_struct() -> CdrType:
    """The single byte that represents a message without fields."""

    def write(out: bytearray, _value: Any) -> None:
        out.append(0)

    def read(data: bytes, at: int, _values: list[Any]) -> int:
        require(data, at + 1)
        return at + 1

    def copy(_value: Any, _values: list[Any]) -> None:
        pass

    return CdrType(write, read, copy, _without_numbers(read))


def text(limit: int = UNLIMITED) -> CdrType:
    """A string of at most `limit` bytes."""

    def write(out: bytearray, value: Any) -> None:
        written = written_text(value) if len(value) < _SHORT else _write_text(value)
        if len(written) > limit + _AROUND_TEXT:
            raise too_many(len(written) - _AROUND_TEXT, limit)
        place = len(out) & 3
        if place:
            out += PADDING[place]
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

    # Most strings are names of frames and joints, which rarely change.
    written_text = functools.lru_cache(_MANY)(_write_text)
    read_text = functools.lru_cache(_MANY)(_read_text)
    unpack_length = LENGTH.unpack_from
    return CdrType(write, read, copy, _without_numbers(read))


def numbers_sequence(code: str, limit: int = UNLIMITED) -> CdrType:
    """A sequence of at most `limit` numbers, an `array.array`."""
    empty = array(code)
    size = empty.itemsize
    # A length and the padding before the first number, by position modulo eight.
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
        if size > HEADER_SIZE:
            at = ((at + 3) & -8) + HEADER_SIZE
        end = at + count * size
        found.frombytes(data[at:end])
        if len(found) != count:
            raise ValueError(CUT_OFF)
        return end

    def copy(value: Any, values: list[Any]) -> None:
        values.append(checked(value)[:])

    return CdrType(write, read, copy, _locate_sequence(np.dtype(code)))


def numbers_array(code: str, count: int) -> CdrType:
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
        out += bytes(-(len(out) - HEADER_SIZE) % size)
        out += found.tobytes()

    def read(data: bytes, at: int, values: list[Any]) -> int:
        at += -(at - HEADER_SIZE) % size
        end = at + count * size
        require(data, end)
        values.append(np.frombuffer(data, dtype, count, at).copy())
        return end

    def copy(value: Any, values: list[Any]) -> None:
        values.append(checked(value).copy())

    def locate(_data: bytes, at: int, names: Sequence[str], found: list[NumberField]) -> int:
        at += -(at - HEADER_SIZE) % size
        found.append(NumberField(names[0], at, dtype, count))
        return at + count * size

    return CdrType(write, read, copy, locate)


def _dtype(code: str) -> np.dtype[Any]:
    return BYTE_DTYPES["octet"] if code == FORMATS["octet"] else np.dtype(code)


def _without_numbers(read: Callable[[bytes, int, list[Any]], int]) -> Locate:
    """Return the `locate` of a type without numbers, which only advances the position."""
    return lambda data, at, _names, _found: read(data, at, [])


def _locate_sequence(dtype: np.dtype[Any]) -> Locate:
    def locate(data: bytes, at: int, names: Sequence[str], found: list[NumberField]) -> int:
        at = (at + 3) & -4
        count: int = LENGTH.unpack_from(data, at)[0]
        at += LENGTH.size
        if not count:
            return at
        at += -(at - HEADER_SIZE) % dtype.itemsize
        found.append(NumberField(names[0], at, dtype, count))
        return at + count * dtype.itemsize

    return locate


def _locate_list(
    locate_one: Locate, fixed_count: int | None, byte_dtype: np.dtype[Any] | None
) -> Locate:
    def locate(data: bytes, at: int, names: Sequence[str], found: list[NumberField]) -> int:
        count = fixed_count
        if count is None:
            at = (at + 3) & -4
            (count,) = LENGTH.unpack_from(data, at)
            at += LENGTH.size
        if byte_dtype is not None:
            if count:
                found.append(NumberField(names[0], at, byte_dtype, count))
            return at + count
        for index in range(count):
            at = locate_one(data, at, (f"{names[0]}.{index}",), found)
        return at

    return locate


def _aligned(formats: Sequence[str], at: int) -> struct.Struct:
    """Build the layout of numbers at a position (modulo eight), including padding."""
    parts, place = ["<"], at - HEADER_SIZE
    for code in formats:
        size = struct.calcsize(f"<{code}")
        gap = -place % size
        parts.append(f"{gap}x{code}")
        place += gap + size
    return struct.Struct("".join(parts))


def _counting(size: int, at: int) -> Callable[[int], bytes]:
    """Return a function that packs a length at a position (modulo 8), and the padding after it."""
    gap = -at % 4
    return struct.Struct(f"<{gap}xI{-(at + gap) % size}x").pack


def _truth(value: Any) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise TypeError("it is not a boolean")
    return bool(value)


def _as_array(code: str, value: Any) -> Any:
    if isinstance(value, str | bytes | bytearray):
        raise TypeError("it is not a sequence of numbers")
    return array(code, value)


def _write_text(value: Any) -> bytes:
    """Serialize a string with its length; it ends at the first NUL, as in C."""
    if not isinstance(value, str):
        raise TypeError("it is not a string")
    content = value.encode().partition(b"\0")[0]
    return LENGTH.pack(len(content) + 1) + content + b"\0"


def _read_text(content: bytes) -> str:
    return content.partition(b"\0")[0].decode(errors="replace")


def list_of(
    element: CdrType,
    *,
    least: int = 0,
    most: int = UNLIMITED,
    byte_dtype: np.dtype[Any] | None = None,
) -> CdrType:
    """A list of strings, octets, booleans or messages; the value is a list or tuple.

    Args:
        element: type of the elements.
        least: minimum number of elements; if equal to `most`, no length is written.
        most: maximum number of elements.
        byte_dtype: dtype of one-byte elements, which `locate` then reports as one field.
    """
    write_one, read_one, copy_one, locate_one = element
    is_fixed = least == most

    def write(out: bytearray, value: Any) -> None:
        _check(value, least, most)
        if not is_fixed:
            out += PADDING[len(out) & 3]
            out += LENGTH.pack(len(value))
        for one in value:
            write_one(out, one)

    def read(data: bytes, at: int, values: list[Any]) -> int:
        count = most
        if not is_fixed:
            at = (at + 3) & -4
            (count,) = LENGTH.unpack_from(data, at)
            at += 4
        # Each element takes at least one byte, so this detects an impossible count before reading.
        require(data, at + count)
        if count > most:
            raise too_many(count, most)
        found: list[Any] = []
        for _ in range(count):
            at = read_one(data, at, found)
        values.append(found)
        return at

    def copy(value: Any, values: list[Any]) -> None:
        _check(value, least, most)
        found: list[Any] = []
        for one in value:
            copy_one(one, found)
        values.append(found)

    locate = _locate_list(locate_one, most if is_fixed else None, byte_dtype)
    return CdrType(write, read, copy, locate)


def strings(limit: int = UNLIMITED) -> CdrType:
    """A sequence of strings; caches the latest one, because joint names rarely change."""
    write_changed, read_changed, copy_changed, locate = list_of(text(), most=limit)
    # Each cache is one value that is replaced as a whole, so several threads may use it.
    written: tuple[list[str] | None, bytes] = (None, b"")
    known: tuple[bytes, list[str]] = (LENGTH.pack(0), [])
    copied: tuple[list[str] | None, list[str]] = (None, [])

    def write(out: bytearray, value: Any) -> None:
        nonlocal written
        place = len(out) & 3
        if place:
            out += PADDING[place]
        names, content = written
        if type(value) is list and value == names:
            out += content
            return
        start = len(out)
        write_changed(out, value)
        written = (list(value), bytes(out[start:]))

    def read(data: bytes, at: int, values: list[Any]) -> int:
        nonlocal known
        at = (at + 3) & -4
        content, names = known
        if data.startswith(content, at):
            values.append(names[:])
            return at + len(content)
        end = read_changed(data, at, values)
        known = (data[at:end], values[-1][:])
        return end

    def copy(value: Any, values: list[Any]) -> None:
        nonlocal copied
        names, content = copied
        if type(value) is list and value == names:
            values.append(content[:])
            return
        copy_changed(value, values)
        copied = (list(value), values[-1][:])

    return CdrType(write, read, copy, locate)


def _check(value: Any, least: int, most: int) -> None:
    if isinstance(value, str | bytes | bytearray):
        raise TypeError("it is not a list")
    if len(value) < least:
        raise ValueError(f"its length is {len(value)}, expected {least}")
    if len(value) > most:
        raise too_many(len(value), most)
