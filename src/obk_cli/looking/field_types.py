"""The types of message fields as generated packages name them: `sequence<double>`, `double[3]`.

In: that text. Out: a closed union. Knows no message.
"""

import re
from dataclasses import dataclass
from typing import Final, Literal

__all__ = ["INTEGERS", "ArrayType", "FieldType", "Message", "Number", "Text", "parse_type"]

INTEGERS: Final = {
    **{f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
    "octet": (0, 255),
    "char": (0, 255),
}
"""Name -> least and greatest value."""


@dataclass(frozen=True, slots=True)
class Number:
    """A number or truth value: `boolean`, `float`, `double`, or one of `INTEGERS`."""

    name: str


@dataclass(frozen=True, slots=True)
class Text:
    """A string."""

    longest: int | None = None
    """Characters; None: as many as there are."""


@dataclass(frozen=True, slots=True)
class Message:
    """A message within the message."""

    name: str
    """`pkg/Name`."""


@dataclass(frozen=True, slots=True)
class ArrayType:
    """Several of the same type."""

    item: "FieldType"
    size: int | None = None
    """How many exactly, or at most; None: any number."""
    rule: Literal["any", "most", "exactly"] = "any"


FieldType = Number | Text | Message | ArrayType

_SEQUENCE: Final = re.compile(r"sequence<(?P<item>.+?)(?:,\s*(?P<most>\d+))?>")
_ARRAY: Final = re.compile(r"(?P<item>.+)\[(?P<size>\d+)\]")
_TEXT: Final = re.compile(r"w?string(?:<(?P<longest>\d+)>)?")


def parse_type(text: str) -> FieldType:
    """The type that a text names; total, as generated packages name no others."""
    if match := _SEQUENCE.fullmatch(text):
        item = parse_type(match["item"])
        if match["most"]:
            return ArrayType(item, int(match["most"]), "most")
        return ArrayType(item)
    if match := _ARRAY.fullmatch(text):
        return ArrayType(parse_type(match["item"]), int(match["size"]), "exactly")
    if match := _TEXT.fullmatch(text):
        return Text(int(match["longest"]) if match["longest"] else None)
    return Message(text) if "/" in text else Number(text)
