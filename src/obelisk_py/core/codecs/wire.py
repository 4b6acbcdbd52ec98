"""What all kinds of fields share: their shape, the wire's constants, what they refuse.

Source: OMG DDS-XTypes 1.3, 7.4 (XCDR version 1).
"""

import struct
from collections.abc import Callable
from typing import Any, Final, NamedTuple

__all__ = ["CUT_OFF", "GAPS", "HEAD", "LENGTH", "REFUSALS", "UNLIMITED", "Kind", "need", "too_many"]

HEAD: Final = 4
"""Bytes before the first field, which say how the rest is written."""
LENGTH: Final = struct.Struct("<I")
GAPS: Final = tuple(bytes(-place % 4) for place in range(4))
"""What fills up to a multiple of four, by the position modulo four."""
UNLIMITED: Final = 2**32 - 1
"""More than this no length can say."""
REFUSALS: Final = (struct.error, TypeError, ValueError, OverflowError, AttributeError)
"""What kinds raise: a value does not fit, or the bytes are none of theirs."""
CUT_OFF: Final = "they end too early"


class Kind(NamedTuple):
    """One kind of field, or several fields that are written together."""

    write: Callable[[bytearray, Any], None]
    """Writes a value behind what is there."""
    read: Callable[[bytes, int, list[Any]], int]
    """Adds the value that stands at a position, or behind filling; the position behind it."""
    copy: Callable[[Any, list[Any]], None]
    """Adds what reading the written value would add."""


def need(data: bytes, end: int) -> None:
    """Make sure that there are so many bytes.

    Raises:
        ValueError: there are not.
    """
    if end > len(data):
        raise ValueError(CUT_OFF)


def too_many(count: int, limit: int) -> ValueError:
    """The error of a string or sequence that is longer than its type allows."""
    return ValueError(f"it holds {count}, at most {limit} are possible")
