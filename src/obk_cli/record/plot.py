"""Plot fields of recorded messages, such as `/arm/joints.position[0]`, as PNG or SVG.

`PlotField` collects the numbers of one field, message by message; `draw` writes the picture with
matplotlib and opens no window.
"""

from array import array
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, Final

from obelisk_spec.suggestions import did_you_mean, list_names
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.files import unwritable, write_bytes
from obk_cli.ros.field_path import field_steps

__all__ = [
    "FORMATS",
    "MOST_LINES",
    "FieldName",
    "Line",
    "PlotField",
    "draw",
    "parse_field",
    "resolve_topic",
]

MOST_LINES: Final = 32
"""Of one field: more cannot be distinguished in a picture."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldName:
    """A field of a topic's messages."""

    topic: str
    steps: tuple[str | int, ...]
    """Names of fields and places in arrays, outermost first."""
    text: str
    """As the user typed it."""


@dataclass(slots=True, kw_only=True)
class Line:
    """One number over time."""

    label: str
    """What follows the field's name: `[2]`, `.x`; empty for the field itself."""
    times_s: list[float] = field(default_factory=list)
    """Since the start of the recording [s]."""
    values: list[float] = field(default_factory=list)


def parse_field(text: str) -> FieldName:
    """Split `TOPIC.FIELD`.

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


def resolve_topic(name: str, topics: Collection[str]) -> str:
    """The topic of a recording that a user means, by its name or the end of it.

    Raises:
        CommandFailedError: no topic or several match.
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


class PlotField:
    """The lines of one field."""

    def __init__(self, name: FieldName) -> None:
        """Start without lines; the first message with numbers creates them."""
        self.name = name
        self._lines: dict[str, Line] = {}

    @property
    def lines(self) -> tuple[Line, ...]:
        """In the order of the message."""
        return tuple(self._lines.values())

    def add(self, time_s: float, message: Any) -> None:
        """Add the field's numbers from a message.

        Raises:
            CommandFailedError: the message has no such field, or it holds no numbers.
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


FORMATS: Final = (".png", ".svg")
WIDTH_IN: Final = 9.0
HEIGHT_IN: Final = 2.6
"""Of one field's plot [inch]."""
DPI: Final = 120
MOST_NAMED: Final = 12
"""PlotField that fit into a legend."""


def draw(fields: Sequence[PlotField], title: str, path: Path) -> None:
    """Write a picture with one plot for each field, one below the other; whole or not at all.

    Raises:
        CommandFailedError: the file cannot be written.
    """
    import matplotlib
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN * len(fields) + 0.8), layout="constrained")
    parts = figure.subplots(len(fields), 1, sharex=True, squeeze=False)
    for part, plotted in zip(parts[:, 0], fields, strict=True):
        for line in plotted.lines:
            part.plot(line.times_s, line.values, linewidth=1.0, label=line.label)
        part.set_ylabel(plotted.name.text, fontsize="small")
        part.grid(visible=True, alpha=0.3)
        if 1 < len(plotted.lines) <= MOST_NAMED:
            part.legend(loc="upper right", fontsize="small")
    parts[-1, 0].set_xlabel("time since start of recording [s]")
    figure.suptitle(title, fontsize="medium")
    # Reproducible bytes, and text stays text.
    picture, kind = BytesIO(), path.suffix.removeprefix(".")
    with matplotlib.rc_context({"svg.hashsalt": "obk", "svg.fonttype": "none"}):
        metadata = {"Date": None} if kind == "svg" else None
        figure.savefig(picture, format=kind, dpi=DPI, metadata=metadata)
    try:
        write_bytes(path, picture.getvalue())
    except OSError as error:
        raise unwritable(path, error) from error
