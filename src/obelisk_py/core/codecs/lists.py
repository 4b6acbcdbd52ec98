"""Kinds of fields that hold several strings, octets, booleans or messages.

Values are lists; tuples and the like are taken too.
"""

from typing import Any

from obelisk_py.core.codecs.kinds import text
from obelisk_py.core.codecs.wire import GAPS, LENGTH, UNLIMITED, Kind, need, too_many

__all__ = ["list_of", "strings"]


def list_of(element: Kind, *, least: int = 0, most: int = UNLIMITED) -> Kind:
    """A list of whatever is no number; one of a fixed size stands without its length."""
    write_one, read_one, copy_one = element
    is_fixed = least == most

    def write(out: bytearray, value: Any) -> None:
        _check(value, least, most)
        if not is_fixed:
            out += GAPS[len(out) & 3]
            out += LENGTH.pack(len(value))
        for one in value:
            write_one(out, one)

    def read(data: bytes, at: int, values: list[Any]) -> int:
        count = most
        if not is_fixed:
            at = (at + 3) & -4
            (count,) = LENGTH.unpack_from(data, at)
            at += 4
        # Each takes a byte at least: what cannot be is found before it is begun.
        need(data, at + count)
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

    return Kind(write, read, copy)


def strings(limit: int = UNLIMITED) -> Kind:
    """A sequence of strings; the newest is remembered, as names of joints are always the same."""
    write_anew, read_anew, copy_anew = list_of(text(), most=limit)
    # Each is one value that is replaced: several threads may be here.
    written: tuple[list[str] | None, bytes] = (None, b"")
    known: tuple[bytes, list[str]] = (LENGTH.pack(0), [])
    copied: tuple[list[str] | None, list[str]] = (None, [])

    def write(out: bytearray, value: Any) -> None:
        nonlocal written
        place = len(out) & 3
        if place:
            out += GAPS[place]
        names, content = written
        if type(value) is list and value == names:
            out += content
            return
        begin = len(out)
        write_anew(out, value)
        written = (list(value), bytes(out[begin:]))

    def read(data: bytes, at: int, values: list[Any]) -> int:
        nonlocal known
        at = (at + 3) & -4
        content, names = known
        if data.startswith(content, at):
            values.append(names[:])
            return at + len(content)
        end = read_anew(data, at, values)
        known = (data[at:end], values[-1][:])
        return end

    def copy(value: Any, values: list[Any]) -> None:
        nonlocal copied
        names, content = copied
        if type(value) is list and value == names:
            values.append(content[:])
            return
        copy_anew(value, values)
        copied = (list(value), values[-1][:])

    return Kind(write, read, copy)


def _check(value: Any, least: int, most: int) -> None:
    if isinstance(value, str | bytes | bytearray):
        raise TypeError("it is no list")
    if len(value) < least:
        raise ValueError(f"it holds {len(value)}, expected {least}")
    if len(value) > most:
        raise too_many(len(value), most)
