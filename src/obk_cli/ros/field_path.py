"""Fields of messages: their types, and paths to them such as `q_joints[0]`.

Paths are checked against the message type, then read from messages.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

from obelisk_spec.suggestions import did_you_mean
from obk_cli.errors import CommandFailedError, MisuseError

__all__ = [
    "HEADER",
    "INTEGERS",
    "MISSING",
    "TIME",
    "ArrayType",
    "FieldType",
    "FieldsOf",
    "Message",
    "Number",
    "Selection",
    "Text",
    "check_selection",
    "field_steps",
    "parse_selection",
    "parse_type",
    "selected",
]

HEADER: Final = "std_msgs/Header"
TIME: Final = "builtin_interfaces/Time"
INTEGERS: Final = {
    **{f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
    "octet": (0, 255),
    "char": (0, 255),
}
"""Name -> minimum and maximum value."""


@dataclass(frozen=True, slots=True)
class Number:
    """A number or boolean: `boolean`, `float`, `double`, or one of `INTEGERS`."""

    name: str


@dataclass(frozen=True, slots=True)
class Text:
    """A string."""

    longest: int | None = None
    """Maximum number of characters; None: no limit."""


@dataclass(frozen=True, slots=True)
class Message:
    """A nested message."""

    name: str
    """`pkg/Name`."""


@dataclass(frozen=True, slots=True)
class ArrayType:
    """Several values of one type."""

    item: "FieldType"
    size: int | None = None
    """Exact or maximum length; None: any."""
    rule: Literal["any", "most", "exactly"] = "any"


FieldType = Number | Text | Message | ArrayType

_SEQUENCE: Final = re.compile(r"sequence<(?P<item>.+?)(?:,\s*(?P<most>\d+))?>")
_ARRAY: Final = re.compile(r"(?P<item>.+)\[(?P<size>\d+)\]")
_TEXT: Final = re.compile(r"w?string(?:<(?P<longest>\d+)>)?")


def parse_type(text: str) -> FieldType:
    """Parse a type's name; accepts every name that generated packages use."""
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


FieldsOf = Callable[[str], Mapping[str, str]]
"""`pkg/Name` -> names and types of that message's fields, as in generated packages."""
_STEP: Final = re.compile(r"\.(?P<name>[A-Za-z]\w*)|\[(?P<index>[0-9]{1,9})\]")


class _Missing:
    """The value of a selected element if the array is shorter than its index."""


MISSING: Final = _Missing()


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """A selected field."""

    steps: tuple[str | int, ...]
    """Field names and array indices, outermost first."""
    text: str
    """As written by the user."""


def parse_selection(text: str) -> Selection:
    """Parse `header.stamp.sec` or `q_joints[0]`.

    Raises:
        MisuseError: the text does not have this form.
    """
    steps = field_steps(text if text.startswith(".") else f".{text}")
    if not steps:
        raise MisuseError(
            f"`{text}` does not name a field",
            help="expected a field such as q_joints[0] or header.stamp.sec",
        )
    return Selection(steps=steps, text=text)


def field_steps(text: str) -> tuple[str | int, ...]:
    """Names and array indices, outermost first, of `.position[0]`; empty if it is not a path."""
    steps = [*_STEP.finditer(text)]
    if sum(len(step[0]) for step in steps) != len(text):
        return ()
    return tuple(step["name"] or int(step["index"]) for step in steps)


def check_selection(selection: Selection, msg_type: str, fields_of: FieldsOf) -> FieldType:
    """The type of the selected field.

    Args:
        selection: the field.
        msg_type: `pkg/Name` of the topic's messages.
        fields_of: looks up the fields of types.

    Raises:
        CommandFailedError: messages of that type have no such field.
    """
    kind: FieldType = Message(msg_type)
    for step in selection.steps:
        match kind, step:
            case ArrayType(item, size, rule), int():
                if size is not None and step >= size:
                    word = "has" if rule == "exactly" else "holds at most"
                    raise CommandFailedError(f"`{selection.text}`: the array {word} {size}")
                kind = item
            case Message(name), str():
                fields = fields_of(name)
                if step not in fields:
                    raise CommandFailedError(
                        f"`{selection.text}`: {name} has no field `{step}`",
                        help=did_you_mean(step, fields),
                    )
                kind = parse_type(fields[step])
            case _, int():
                raise CommandFailedError(f"`{selection.text}`: [{step}] needs an array")
            case _:
                raise CommandFailedError(f"`{selection.text}`: `{step}` needs a message")
    return kind


def selected(message: Any, selection: Selection) -> Any:
    """The value in a message of the checked type; `MISSING` if an array is too short.

    Args:
        message: of a generated package, or plain data.
        selection: the field.
    """
    value = message
    for step in selection.steps:
        if isinstance(step, str):
            value = value[step] if isinstance(value, dict) else getattr(value, step)
        elif step < len(value):
            value = value[step]
        else:
            return MISSING
    return value
