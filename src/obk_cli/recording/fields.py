"""Fields of recorded messages by name: `/arm/joints.position[0]`, and the numbers in them.

In: what a user types, and decoded messages. Out: lines for a picture. Reads no file.
"""

from array import array
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from obelisk_spec.suggestions import did_you_mean, list_names
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.recording.steps import field_steps

__all__ = ["MOST_LINES", "FieldName", "Line", "Lines", "parse_field", "topic_meant"]

MOST_LINES: Final = 32
"""Of one field: more cannot be told apart in a picture."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldName:
    """A field of a topic's messages."""

    topic: str
    steps: tuple[str | int, ...]
    """Names of fields and places in arrays, outermost first."""
    text: str
    """As the user has it."""


@dataclass(slots=True, kw_only=True)
class Line:
    """One number over time."""

    label: str
    """What follows the field's name: `[2]`, `.x`; empty for the field itself."""
    times_s: list[float] = field(default_factory=list)
    """Since the begin of the recording [s]."""
    values: list[float] = field(default_factory=list)


def parse_field(text: str) -> FieldName:
    """Take `TOPIC.FIELD` apart.

    Raises:
        MisuseError: it is not of that form.
    """
    topic, dot, rest = text.partition(".")
    steps = field_steps(dot + rest)
    if not topic or not steps:
        raise MisuseError(
            f"`{text}` names no field",
            help="expected TOPIC.FIELD, such as /arm/joints.position[0] or imu.gyro.x",
        )
    return FieldName(topic=topic, steps=steps, text=text)


def topic_meant(name: str, topics: Collection[str]) -> str:
    """The topic of a recording that a user means, by its name or the end of it.

    Raises:
        CommandFailedError: there is none, or there are several.
    """
    if name in topics:
        return name
    meant = [topic for topic in topics if topic.endswith(f"/{name.lstrip('/')}")]
    if len(meant) == 1:
        return meant[0]
    if meant:
        raise CommandFailedError(f"`{name}` means several topics: {list_names(meant)}")
    raise CommandFailedError(
        f"the recording has no topic `{name}`",
        help=did_you_mean(name, topics) or f"it has {list_names(topics) or 'none'}",
    )


class Lines:
    """The lines of one field, filled message by message."""

    def __init__(self, name: FieldName) -> None:
        """Begin with none."""
        self.name = name
        self._lines: dict[str, Line] = {}

    @property
    def lines(self) -> tuple[Line, ...]:
        """In the order of the message."""
        return tuple(self._lines.values())

    def add(self, time_s: float, message: Any) -> None:
        """Take the field's numbers from a message.

        Raises:
            CommandFailedError: the message has no such field, or no numbers are in it.
        """
        for label, number in _numbers(self._value(message), ""):
            if label not in self._lines:
                if len(self._lines) == MOST_LINES:
                    raise CommandFailedError(
                        f"`{self.name.text}` has more than {MOST_LINES} numbers",
                        help=f"name one of them: {self.name.text}{label}",
                    )
                self._lines[label] = Line(label=label)
            line = self._lines[label]
            line.times_s.append(time_s)
            line.values.append(number)

    def _value(self, message: Any) -> Any:
        value = message
        for step in self.name.steps:
            if isinstance(step, int):
                if not _is_array(value):
                    raise CommandFailedError(f"`{self.name.text}`: [{step}] is of no array")
                if step >= len(value):
                    return ()  # this message has fewer
                value = value[step]
                continue
            known = _field_names(value)
            if step not in known:
                raise CommandFailedError(
                    f"`{self.name.text}`: there is no field `{step}`",
                    help=did_you_mean(step, known) or f"there are {list_names(known) or 'none'}",
                )
            value = getattr(value, step)
        if not _is_array(value) and next(_numbers(value, ""), None) is None:
            raise CommandFailedError(f"`{self.name.text}` holds no number")
        return value


def _numbers(value: Any, label: str) -> Iterator[tuple[str, float]]:
    if isinstance(value, bool | int | float):
        yield label, float(value)
    elif _is_array(value):
        for place, item in enumerate(value):
            yield from _numbers(item, f"{label}[{place}]")
    else:
        for name in _field_names(value):
            yield from _numbers(getattr(value, name), f"{label}.{name}")


def _is_array(value: Any) -> bool:
    return isinstance(value, Sequence | array) and not isinstance(value, str)


def _field_names(value: Any) -> Sequence[str]:
    """The fields of a decoded message; a number or a text has none."""
    slots: Sequence[str] = getattr(type(value), "__slots__", ())
    return slots if not isinstance(value, str | bool | int | float) else ()
