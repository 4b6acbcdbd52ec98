"""Fields of messages that a user selects, `q_joints[0]`: checked against the type, then taken.

In: what a user types, a message type's fields, messages of generated packages. Out: values.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from obelisk_spec.suggestions import did_you_mean
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.looking.field_types import ArrayType, FieldType, Message, parse_type
from obk_cli.recording.steps import field_steps

__all__ = ["MISSING", "FieldsOf", "Selection", "check_selection", "parse_selection", "selected"]

FieldsOf = Callable[[str], Mapping[str, str]]
"""`pkg/Name` -> the names and types of that message's fields, as generated packages name them."""


class _Missing:
    """What an array that is shorter than usual has in the place that was selected."""


MISSING: Final = _Missing()


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """One field."""

    steps: tuple[str | int, ...]
    """Names of fields and places in arrays, outermost first."""
    text: str
    """As the user has it."""


def parse_selection(text: str) -> Selection:
    """Take `header.stamp.sec` or `q_joints[0]` apart.

    Raises:
        MisuseError: it is not of that form.
    """
    steps = field_steps(text if text.startswith(".") else f".{text}")
    if not steps:
        raise MisuseError(
            f"`{text}` names no field", help="expected such as q_joints[0] or header.stamp.sec"
        )
    return Selection(steps=steps, text=text)


def check_selection(selection: Selection, msg_type: str, fields_of: FieldsOf) -> FieldType:
    """The type of the field that is selected.

    Args:
        selection: the field.
        msg_type: `pkg/Name` of the topic's messages.
        fields_of: where types are looked up.

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
                raise CommandFailedError(f"`{selection.text}`: [{step}] is of no array")
            case _:
                raise CommandFailedError(f"`{selection.text}`: `{step}` is of no message")
    return kind


def selected(message: Any, selection: Selection) -> Any:
    """The value in a message of the checked type; `MISSING` where its array has fewer.

    Args:
        message: of a generated package, or as plain data.
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
