"""Store a ROS parameter's limits, unit and time of effect as text in its descriptor.

ROS has fields for a range with both limits and for a description. Everything else that `Parameter`
declares is stored in the `additional_constraints` field, as `name: value` separated by semicolons:

    unit: N m/rad; at least: 0.0; takes effect: between callbacks

Source: rcl_interfaces/msg/ParameterDescriptor (additional_constraints is for people and tools).
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from obelisk_spec.suggestions import ask_for, list_names, near_names, with_number
from obelisk_spec.values import ParameterValue

__all__ = ["ParameterNotes", "parse_notes"]

AT_ONCE: Final = "between callbacks"
AT_CONFIGURE: Final = "at configure"
_UNIT, _LEAST, _MOST, _CHOICES = "unit", "at least", "at most", "one of"
_EFFECT, _INITIAL = "takes effect", "initial"


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterNotes:
    """A parameter's limits and unit, and when a new value takes effect."""

    unit: str = ""
    least: float | None = None
    """Minimum of the value, or of each item in a list; None for no limit."""
    most: float | None = None
    """Maximum of the value, or of each item in a list; None for no limit."""
    choices: tuple[str, ...] = ()
    """The allowed strings; empty if any is allowed."""
    length: int | None = None
    """Number of items in a list; None if any number is allowed, or if read from a descriptor."""
    is_live: bool | None = None
    """Whether a new value takes effect before the next `configure` transition; None if unknown."""
    initial: ParameterValue | None = None
    """The value at construction of the node, from config or default; None if unknown."""

    @property
    def range(self) -> str:
        """`0.0 to 200.0`, `at least 0.0`, `at most 200.0`, or empty."""
        return range_text(self.least, self.most)

    def fault(self, value: object) -> str | None:
        """Why a value is invalid, "is 500.0 N m/rad, expected 0.0 to 200.0"; None if valid."""
        if self.choices and value not in self.choices:
            hint = ask_for(near_names(str(value), self.choices))
            wrong = f"is `{value}`, expected one of {list_names(self.choices)}"
            return f"{wrong}; {hint}" if hint else wrong
        items = value if isinstance(value, list | tuple) else [value]
        if self.length is not None and len(items) != self.length:
            return f"has {with_number(len(items), 'item')}, expected {self.length}"
        for item in items:
            if isinstance(item, bool) or not isinstance(item, int | float):
                continue
            if not math.isfinite(item):
                return f"is {item}, expected a finite number"
            if (self.least is not None and item < self.least) or (
                self.most is not None and item > self.most
            ):
                where = "has" if items is value else "is"
                unit = f" {self.unit}" if self.unit else ""
                return f"{where} {item}{unit}, expected {self.range}"
        return None

    def text(self, *, has_range_field: bool) -> str:
        """Format the `additional_constraints` field.

        Args:
            has_range_field: whether another field of the descriptor has both limits.
        """
        parts = {
            _UNIT: self.unit,
            _LEAST: None if has_range_field else self.least,
            _MOST: None if has_range_field else self.most,
            _CHOICES: ", ".join(self.choices),
            _EFFECT: {True: AT_ONCE, False: AT_CONFIGURE, None: ""}[self.is_live],
            _INITIAL: "" if self.initial is None else json.dumps(self.initial),
        }
        return "; ".join(
            f"{name}: {part}" for name, part in parts.items() if part not in ("", None)
        )


def range_text(least: float | None, most: float | None) -> str:
    """`0.0 to 200.0`, `at least 0.0`, `at most 200.0`, or empty."""
    if least is not None and most is not None:
        return f"{least} to {most}"
    if least is not None:
        return f"at least {least}"
    return "" if most is None else f"at most {most}"


def parse_notes(text: str) -> ParameterNotes:
    """Parse an `additional_constraints` field; ignore text that other software wrote."""
    # `initial` comes last, because a string in it may contain semicolons.
    head, _, initial = f"; {text}".partition(f"; {_INITIAL}: ")
    parts: Mapping[str, str] = {
        name.strip(): part.strip()
        for name, colon, part in (item.partition(":") for item in head.split(";"))
        if colon
    }
    choices = parts.get(_CHOICES, "")
    return ParameterNotes(
        unit=parts.get(_UNIT, ""),
        least=_number(parts.get(_LEAST)),
        most=_number(parts.get(_MOST)),
        choices=tuple(choice.strip() for choice in choices.split(",")) if choices else (),
        initial=_initial(initial),
        is_live={AT_ONCE: True, AT_CONFIGURE: False}.get(parts.get(_EFFECT, "")),
    )


def _initial(text: str) -> ParameterValue | None:
    try:
        value = json.loads(text)
    except ValueError:
        return None
    if isinstance(value, list):
        is_of_numbers = all(isinstance(item, int | float) for item in value)
        return tuple(value) if is_of_numbers else None
    return value if isinstance(value, bool | int | float | str) else None


def _number(text: str | None) -> float | None:
    if text is None:
        return None
    try:
        return int(text)
    except ValueError:
        pass
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
