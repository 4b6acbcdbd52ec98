"""Check a user's message against its type, and report all faults at once.

The result is data that matches the type, and sentences about what does not; no message is created.
"""

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from math import inf
from typing import Any, Final

from obelisk_spec.suggestions import did_you_mean
from obk_cli.errors import MisuseError
from obk_cli.ros.field_path import (
    HEADER,
    INTEGERS,
    TIME,
    ArrayType,
    FieldsOf,
    FieldType,
    Message,
    Number,
    Text,
    parse_type,
)

__all__ = ["Data", "Now", "Plain", "columns", "fill", "plain_data", "require_fit"]


class Now(Enum):
    """The time at which a message is published."""

    NOW = "now"


Data = bool | int | float | str | Now | list["Data"] | dict[str, "Data"]

MOST_FAULTS: Final = 20
GREATEST: Final = {"float": 3.4028234663852886e38, "double": sys.float_info.max}


@dataclass(frozen=True, slots=True, kw_only=True)
class Filled:
    """The result of checking a value."""

    data: Data
    """The given fields; valid only if there are no faults."""
    faults: tuple[str, ...]
    """Each names a field, its value, and the expected type."""


def fill(value: object, msg_type: str, fields_of: FieldsOf) -> Filled:
    """Check a YAML value against a message type.

    Args:
        value: an object with fields, or None for the default message. `auto` may replace a
            `Header`, and `now` a `Time`: the time of publishing.
        msg_type: `pkg/Name`.
        fields_of: looks up the fields of types.
    """
    filler = _Filler(fields_of)
    given = {} if value is None else value
    data = filler.take(given, Message(msg_type), "")
    return Filled(data=data, faults=tuple(filler.faults))


def require_fit(value: object, msg_type: str, fields_of: FieldsOf) -> Data:
    """Check a user's fields against a message type as `fill` does.

    Raises:
        MisuseError: they do not match; all faults are listed.
    """
    filled = fill(value, msg_type, fields_of)
    if filled.faults:
        shown = filled.faults[:MOST_FAULTS]
        more = len(filled.faults) - len(shown)
        lines = [*(f"  {fault}" for fault in shown), *([f"  and {more} more"] if more else ())]
        raise MisuseError(
            "\n".join([f"the message does not fit {msg_type}:", *lines]),
            help=", ".join(f"{name}: {kind}" for name, kind in fields_of(msg_type).items()) or None,
        )
    return filled.data


class _Filler:
    def __init__(self, fields_of: FieldsOf) -> None:
        self._fields_of = fields_of
        self.faults: list[str] = []

    def take(self, value: object, kind: FieldType, place: str) -> Data:
        """Convert a value to the type; records a fault if it does not match."""
        match kind:
            case Message(name):
                return self._message(value, name, place)
            case ArrayType():
                return self._array(value, kind, place)
            case Text(longest):
                return self._text(value, longest, place)
            case Number(name):
                return self._number(value, name, place)

    def _message(self, value: object, name: str, place: str) -> Data:
        if name == HEADER and value == "auto":
            return {"stamp": Now.NOW}
        if name == TIME and value == "now":
            return Now.NOW
        fields = self._fields_of(name)
        if not isinstance(value, Mapping):
            short = {HEADER: " or `auto`", TIME: " or `now`"}.get(name, "")
            self._note(place, f"expected {_fields_text(name, fields)}{short}, got {_shown(value)}")
            return {}
        data: dict[str, Data] = {}
        for key, item in value.items():
            inner = f"{place}.{key}" if place else str(key)
            if key in fields:
                data[str(key)] = self.take(item, parse_type(fields[key]), inner)
            else:
                self._note(inner, f"{name} has no such field; {_hint(str(key), fields)}")
        return data

    def _array(self, value: object, kind: ArrayType, place: str) -> Data:
        if not isinstance(value, list):
            self._note(place, f"expected {_array_text(kind)}, got {_shown(value)}")
            return []
        wrong = kind.size is not None and (
            len(value) != kind.size if kind.rule == "exactly" else len(value) > kind.size
        )
        if wrong:
            self._note(place, f"expected {_array_text(kind)}, got {len(value)}")
        return [self.take(item, kind.item, f"{place}[{n}]") for n, item in enumerate(value)]

    def _text(self, value: object, longest: int | None, place: str) -> Data:
        if not isinstance(value, str):
            self._note(place, f'expected a string, got {_shown(value)}; write "{value}"')
            return ""
        if longest is not None and len(value) > longest:
            self._note(place, f"expected at most {longest} characters, got {len(value)}")
        return value

    def _number(self, value: object, name: str, place: str) -> Data:
        if name == "boolean":
            if isinstance(value, bool):
                return value
            self._note(place, f"expected true or false, got {_shown(value)}")
            return False
        # In Python, True equals 1.
        number = None if isinstance(value, bool) else value
        if name in GREATEST:
            if isinstance(number, int | float) and _is_held(number, GREATEST[name]):
                return float(number)
            self._note(place, f"expected a {name}, got {_shown(value)}")
            return 0.0
        low, high = INTEGERS[name]
        if isinstance(number, int) and low <= number <= high:
            return number
        expected = f"a whole number from {low} to {high} ({name})"
        self._note(place, f"expected {expected}, got {_shown(value)}")
        return 0

    def _note(self, place: str, fault: str) -> None:
        self.faults.append(f"{place}: {fault}" if place else fault)


def _is_held(value: float, greatest: float) -> bool:
    return abs(value) <= greatest or abs(value) == inf or value != value


def _hint(key: str, fields: Mapping[str, str]) -> str:
    before, colon, after = key.partition(":")
    if colon and before in fields:
        return f"a space is missing: `{before}: {after}`"
    return did_you_mean(key, fields) or "it has no fields"


def _fields_text(name: str, fields: Mapping[str, str]) -> str:
    shown = ", ".join(f"{field}: {kind}" for field, kind in fields.items())
    return f"{name} {{{shown}}}"


def _array_text(kind: ArrayType) -> str:
    many = {"any": "", "most": f"at most {kind.size} ", "exactly": f"{kind.size} "}[kind.rule]
    return f"a list of {many}{_item_text(kind.item)}"


def _item_text(kind: FieldType) -> str:
    match kind:
        case Message(name) | Number(name):
            return f"{name}s" if isinstance(kind, Number) else name
        case Text():
            return "strings"
        case ArrayType():
            return "lists"


def _shown(value: object) -> str:
    """A value, for a message."""
    if isinstance(value, list | dict):
        return "a list" if isinstance(value, list) else "an object"
    if value is None or isinstance(value, bool):
        return {None: "nothing", True: "true", False: "false"}[value]
    return f"`{value}`"


Plain = None | bool | int | float | str | list["Plain"] | dict[str, "Plain"]


def plain_data(value: Any) -> Plain:
    """Convert a message, or a field's value, to plain data."""
    fields: Mapping[str, str] | None = (
        value.get_fields_and_field_types() if hasattr(value, "get_fields_and_field_types") else None
    )
    if fields is not None:
        return {name: plain_data(getattr(value, name)) for name in fields}
    if isinstance(value, bytes):  # a single octet
        return value[0]
    if isinstance(value, list | tuple):
        return [plain_data(item) for item in value]
    # Arrays of numbers, and single numbers of numpy arrays.
    plain: Plain = value.tolist() if hasattr(value, "tolist") else value
    return plain


def columns(value: Plain, name: str) -> Iterator[tuple[str, Plain]]:
    """The single values in a value with their names: `header.stamp.sec`, `q_joints[0]`.

    Args:
        value: plain data.
        name: its own name; empty for a whole message.
    """
    if isinstance(value, dict):
        for field, item in value.items():
            yield from columns(item, f"{name}.{field}" if name else field)
    elif isinstance(value, list):
        for place, item in enumerate(value):
            yield from columns(item, f"{name}[{place}]")
    else:
        yield name, value
