"""CDR types: write, read, copy and locate one field, or several consecutive fields.

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
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.serialization.codegen import (
    CdrType,
    Functions,
    Locate,
    NumberField,
    functions_of,
)

__all__ = [
    "BYTE_DTYPES",
    "CONVERSION_ERRORS",
    "FORMATS",
    "HEADER_SIZE",
    "UNLIMITED",
    "empty_struct",
    "flag",
    "list_of",
    "numbers",
    "numbers_array",
    "numbers_sequence",
    "strings",
    "text",
    "with_functions",
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


def require(data: bytes, end: int) -> None:
    """Raise ValueError if the data is shorter than `end` bytes."""
    if end > len(data):
        raise ValueError(CUT_OFF)


def require_at_most(count: int, limit: int) -> None:
    """Raise ValueError if a string or sequence exceeds the limit of its type."""
    if count > limit:
        raise ValueError(f"its length is {count}, expected at most {limit}")


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
_AROUND_TEXT: Final = 5
"""Size of a string's length and its final NUL [bytes]."""
_SHORT: Final = 256
_MANY: Final = 1024
_TRUTHS: Final = {b"\0": False, b"\1": True}


def with_functions(functions: Functions, locate: Locate) -> CdrType:
    """A type whose lines call functions, because it is rare or needs a loop."""
    return CdrType(
        write="$write_value(out, $value)",
        read="$target, at = $read_value(data, at)",
        copy="$target = $copy_value($value)",
        names={f"{name}_value": function for name, function in functions._asdict().items()},
        locate=locate,
    )


@functools.cache
def numbers(formats: tuple[str, ...]) -> CdrType:
    """Consecutive numbers, even across nested messages."""
    # One layout for each position modulo eight, so that padding costs nothing.
    layouts = tuple(_aligned(formats, at) for at in range(_ALIGNMENT))

    def locate(_data: bytes, at: int, names: Sequence[str], found: list[NumberField]) -> int:
        for name, code in zip(names, formats, strict=True):
            dtype = _dtype(code)
            at += -(at - HEADER_SIZE) % dtype.itemsize
            found.append(NumberField(name, at, dtype, 1))
            at += dtype.itemsize
        return at

    return CdrType(
        write="out += $packers[len(out) & 7]($value)",
        read="""\
layout = $layouts[at & 7]
$target, = layout.unpack_from(data, at)
at += layout.size""",
        copy="$target, = $unpack($pack($value))",
        names={
            "packers": tuple(layout.pack for layout in layouts),
            "layouts": layouts,
            "pack": layouts[HEADER_SIZE].pack,
            "unpack": layouts[HEADER_SIZE].unpack,
        },
        locate=locate,
    )


@functools.cache
def flag() -> CdrType:
    """A boolean."""

    def locate(_data: bytes, at: int, names: Sequence[str], found: list[NumberField]) -> int:
        found.append(NumberField(names[0], at, BYTE_DTYPES["boolean"], 1))
        return at + 1

    return CdrType(
        write="out.append($truth($value))",
        read="$target, at = $read_truth(data, at)",
        copy="$target = $truth($value)",
        names={"truth": _truth, "read_truth": _read_truth},
        locate=locate,
    )


def empty_struct() -> CdrType:
    """The single byte that represents a message without fields."""

    def read(data: bytes, at: int) -> tuple[None, int]:
        require(data, at + 1)
        return None, at + 1

    return CdrType(
        write="out.append(0)",
        read="_, at = $read_byte(data, at)",
        copy="",
        names={"read_byte": read},
        locate=lambda data, at, _names, _found: read(data, at)[1],
    )


@functools.cache
def text(limit: int = UNLIMITED) -> CdrType:
    """A string of at most `limit` bytes."""
    written = f"""\
value = $value
written = $written_text(value) if len(value) < {_SHORT} else $write_text(value)
{_limited(f"len(written) - {_AROUND_TEXT}", limit)}"""
    # Most strings are names of frames and joints, which rarely change.
    return CdrType(
        write=f"""\
{written}
out += $padding[len(out) & 3]
out += written""",
        read=f"""\
at = (at + 3) & -4
length = $unpack_length(data, at)[0]
at += 4
content = data[at : at + length]
if len(content) != length: raise ValueError("{CUT_OFF}")
{_limited("length - 1", limit)}
$target = $known_text(content) if length < {_SHORT} else $read_text(content)
at += length""",
        copy=f"""\
{written}
$target = value if "\\0" not in value else value.partition("\\0")[0]""",
        names={
            "written_text": functools.lru_cache(_MANY)(_write_text),
            "write_text": _write_text,
            "known_text": functools.lru_cache(_MANY)(_read_text),
            "read_text": _read_text,
            "unpack_length": LENGTH.unpack_from,
            "padding": PADDING,
            "require_at_most": require_at_most,
        },
        locate=_locate_text,
    )


@functools.cache
def numbers_sequence(code: str, limit: int = UNLIMITED) -> CdrType:
    """A sequence of at most `limit` numbers, an `array.array`."""
    empty = array(code)
    size = empty.itemsize
    checked = f"""\
value = $value
if type(value) is not $array or value.typecode != "{code}": value = $as_array("{code}", value)
{_limited("len(value)", limit)}"""
    return CdrType(
        write=f"""\
{checked}
if value:
    out += $heads[len(out) & 7](len(value))
    out += value
else: out += $heads_of_empty[len(out) & 3]""",
        read=f"""\
at = (at + 3) & -4
count = $unpack_length(data, at)[0]
at += 4
$target = value = $empty[:]
if count:
    {_limited("count", limit)}
    {"at = ((at + 3) & -8) + 4" if size > HEADER_SIZE else ""}
    end = at + count * {size}
    value.frombytes(data[at:end])
    if len(value) != count: raise ValueError("{CUT_OFF}")
    at = end""",
        copy=f"""\
{checked}
$target = value[:]""",
        names={
            # A length and the padding before the first number, by position modulo eight.
            "heads": tuple(_counting(size, at) for at in range(_ALIGNMENT)),
            "heads_of_empty": tuple(struct.pack(f"<{-at % 4}xI", 0) for at in range(4)),
            "unpack_length": LENGTH.unpack_from,
            "empty": empty,
            "array": array,
            "as_array": _as_array,
            "require_at_most": require_at_most,
        },
        locate=_locate_sequence(np.dtype(code)),
    )


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

    def read(data: bytes, at: int) -> tuple[NDArray[Any], int]:
        at += -(at - HEADER_SIZE) % size
        end = at + count * size
        require(data, end)
        return np.frombuffer(data, dtype, count, at).copy(), end

    def copy(value: Any) -> NDArray[Any]:
        return checked(value).copy()

    def locate(_data: bytes, at: int, names: Sequence[str], found: list[NumberField]) -> int:
        at += -(at - HEADER_SIZE) % size
        found.append(NumberField(names[0], at, dtype, count))
        return at + count * size

    return with_functions(Functions(write, read, copy), locate)


def list_of(
    element: Callable[[], Functions],
    locate_element: Locate,
    *,
    least: int = 0,
    most: int = UNLIMITED,
    byte_dtype: np.dtype[Any] | None = None,
) -> CdrType:
    """A list of strings, octets, booleans or messages; the value is a list or tuple.

    Args:
        element: returns the functions of the elements, which are compiled when first used.
        locate_element: locates the numbers of an element.
        least: minimum number of elements; if equal to `most`, no length is written.
        most: maximum number of elements.
        byte_dtype: dtype of one-byte elements, which `locate` then reports as one field.
    """
    is_fixed = least == most

    def write(out: bytearray, value: Any) -> None:
        _check(value, least, most)
        if not is_fixed:
            out += PADDING[len(out) & 3]
            out += LENGTH.pack(len(value))
        write_one = element().write
        for one in value:
            write_one(out, one)

    def read(data: bytes, at: int) -> tuple[list[Any], int]:
        count = most
        if not is_fixed:
            at = (at + 3) & -4
            (count,) = LENGTH.unpack_from(data, at)
            at += 4
        # Each element takes at least one byte, so this detects an impossible count before reading.
        require(data, at + count)
        require_at_most(count, most)
        found: list[Any] = []
        read_one = element().read
        for _ in range(count):
            one, at = read_one(data, at)
            found.append(one)
        return found, at

    def copy(value: Any) -> list[Any]:
        _check(value, least, most)
        copy_one = element().copy
        return [copy_one(one) for one in value]

    locate = _locate_list(locate_element, most if is_fixed else None, byte_dtype)
    return with_functions(Functions(write, read, copy), locate)


def strings(limit: int = UNLIMITED) -> CdrType:
    """A sequence of at most `limit` strings; caches the newest, as joint names rarely change."""
    changed = list_of(functools.partial(functions_of, text()), _locate_text, most=limit)
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
        functions_of(changed).write(out, value)
        written = (list(value), bytes(out[start:]))

    def read(data: bytes, at: int) -> tuple[list[str], int]:
        nonlocal known
        at = (at + 3) & -4
        content, names = known
        if data.startswith(content, at):
            return names[:], at + len(content)
        found, end = functions_of(changed).read(data, at)
        known = (data[at:end], found[:])
        return found, end

    def copy(value: Any) -> list[str]:
        nonlocal copied
        names, content = copied
        if type(value) is list and value == names:
            return content[:]
        found: list[str] = functions_of(changed).copy(value)
        copied = (list(value), found[:])
        return found

    return with_functions(Functions(write, read, copy), changed.locate)


def _limited(count: str, limit: int) -> str:
    """A line that checks the length of a string or sequence; nothing if it has no limit."""
    return "" if limit == UNLIMITED else f"$require_at_most({count}, {limit})"


def _dtype(code: str) -> np.dtype[Any]:
    return BYTE_DTYPES["octet"] if code == FORMATS["octet"] else np.dtype(code)


def _locate_text(data: bytes, at: int, _names: Sequence[str], _found: list[NumberField]) -> int:
    at = (at + 3) & -4
    length: int = LENGTH.unpack_from(data, at)[0]
    return at + LENGTH.size + length


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


def _read_truth(data: bytes, at: int) -> tuple[bool, int]:
    try:
        return _TRUTHS[data[at : at + 1]], at + 1
    except KeyError:
        raise ValueError("it is neither false nor true") from None


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


def _check(value: Any, least: int, most: int) -> None:
    if isinstance(value, str | bytes | bytearray):
        raise TypeError("it is not a list")
    if len(value) < least:
        raise ValueError(f"its length is {len(value)}, expected {least}")
    require_at_most(len(value), most)
