"""Plot fields of recorded runs, such as `/arm/joints.position[0]`, as PNG, SVG or a web page.

`plot_parts` reads the numbers. `draw` writes a plot with matplotlib; `write_page` writes one
file for the browser with zoom and cursor, which needs no network. The page uses
`page/uPlot.iife.min.js`: uPlot 1.6.32, unchanged, under the MIT license in `page/uPlot.LICENSE`.
"""

import base64
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib.resources import files
from io import BytesIO
from itertools import islice
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from obelisk_recordings.run import RecordedRun, topic_named
from obelisk_recordings.topic import RecordedSignal
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.files import unwritable, write_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "HEIGHT_IN",
    "MOST_LINES",
    "MOST_NAMED",
    "WIDTH_IN",
    "FieldName",
    "PlotPart",
    "check_time_range",
    "draw",
    "packed_line",
    "parse_field",
    "plot_parts",
    "save_figure",
    "write_page",
]


Floats = NDArray[np.float64]
_PATH: Final = re.compile(r"(?:\.[A-Za-z]\w*|\[(?:[0-9]{1,9}|[^\W\d][^\[\]]*)\])+")
"""`.position[0]`, or `.position[knee]`."""
MOST_LINES: Final = 32
"""Maximum number of lines of a field; more cannot be distinguished in a plot."""
MOST_POINTS: Final = 100_000
"""Maximum number of points of a line; the page gets the extremes of intervals of a longer one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldName:
    """A field of a topic's messages."""

    topic: str
    path: str
    """Path within the message: `position[0]`, `position[knee]`."""
    text: str
    """As typed by the user."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlotLine:
    """One number over time."""

    label: str
    """Run, field, joint, as far as they are not in the title; may be empty for a single line."""
    times_s: Floats
    """[s since activation], shape `(n,)`."""
    values: Floats
    """Shape `(n,)`."""
    run: int
    """Index of its run, which determines the line style."""
    colour: int
    """Index of its number in the part; the same number of another run has the same color."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlotPart:
    """A plot with one axis of values."""

    title: str
    unit: str
    """Empty if there is no unit, or several."""
    lines: tuple[PlotLine, ...]

    @property
    def label(self) -> str:
        """Title and unit."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title


def parse_field(text: str) -> FieldName:
    """Split `TOPIC.FIELD`.

    Raises:
        MisuseError: the text does not have this form.
    """
    topic, dot, path = text.partition(".")
    if not topic or not _PATH.fullmatch(dot + path):
        raise MisuseError(
            f"`{text}` does not name a field",
            help="expected TOPIC.FIELD, such as /arm/joints.position[0] or imu.gyro.x",
        )
    return FieldName(topic=topic, path=path, text=text)


@dataclass(slots=True, kw_only=True)
class _Collected:
    """One number of one run while it is read."""

    label: str
    unit: str
    times_s: list[Floats] = field(default_factory=list)
    values: list[Floats] = field(default_factory=list)


def plot_parts(
    runs: Sequence[RecordedRun],
    fields: Sequence[FieldName],
    *,
    by_receipt: bool = False,
    overlay: bool = False,
) -> tuple[PlotPart, ...]:
    """Read fields of all runs: one part per field, or one part for all.

    Args:
        runs: the recordings; each field must be in at least one of them.
        fields: what to read.
        by_receipt: whether to use times of receipt instead of publication.
        overlay: whether all fields share one part.

    Raises:
        CommandFailedError: a field has no recorded numbers, or too many.
        RecordingError: a recording cannot be read, or no run has the topic or field.
    """
    found = [_read(run, fields, by_receipt=by_receipt) for run in runs]
    parts = []
    for place, name in enumerate(fields):
        of_runs = [numbers[place] for numbers in found]
        if not any(of_runs):
            raise CommandFailedError(f"`{name.text}`: no numbers were recorded")
        if max(map(len, of_runs)) > MOST_LINES:
            several = next(numbers for numbers in of_runs if len(numbers) > MOST_LINES)
            example = [*several][MOST_LINES]
            raise CommandFailedError(
                f"`{name.text}` has more than {MOST_LINES} numbers",
                help=f"select one, such as {name.topic}.{example}",
            )
        parts.append(_part(runs, name, of_runs))
    return (_overlaid(parts),) if overlay and len(parts) > 1 else tuple(parts)


def _read(
    run: RecordedRun, fields: Sequence[FieldName], *, by_receipt: bool
) -> list[dict[str, _Collected]]:
    """For each field, its numbers by path."""
    topics = [topic_named(name.topic, run.topics) for name in fields]
    found: list[dict[str, _Collected]] = [{} for _ in fields]
    for part in run.parts(topics):
        for place, name in enumerate(fields):
            if topics[place] != part.name:
                continue
            for signal in islice(part.signals(name.path), MOST_LINES + 1):
                number = found[place].setdefault(
                    _key(signal), _Collected(label=_label(signal, name), unit=signal.unit)
                )
                values = signal.values()
                known = ~np.isnan(values) | (signal.place is None)
                number.times_s.append((part.received if by_receipt else part.t)[known])
                number.values.append(values[known])
    return found


def _key(signal: RecordedSignal) -> str:
    return signal.path if signal.place is None else f"{signal.path}[{signal.place}]"


def _label(signal: RecordedSignal, name: FieldName) -> str:
    """The name of a number within its field: `knee`, `[2]`, `x`; empty if it has none."""
    is_whole = _key(signal) == name.path
    text = signal.label.removeprefix(signal.path if is_whole else name.path)
    if named := re.fullmatch(r"\[(\D.*)\]", text):
        return named[1]
    return "" if is_whole else text.removeprefix(".")


def _part(
    runs: Sequence[RecordedRun], name: FieldName, of_runs: Sequence[dict[str, _Collected]]
) -> PlotPart:
    keys = list(dict.fromkeys(key for numbers in of_runs for key in numbers))
    lines = []
    for place, (run, numbers) in enumerate(zip(runs, of_runs, strict=True)):
        for key, number in numbers.items():
            words = (run.name if len(runs) > 1 else "", number.label)
            lines.append(
                PlotLine(
                    label=" ".join(filter(None, words)),
                    times_s=np.concatenate(number.times_s),
                    values=np.concatenate(number.values),
                    run=place,
                    colour=keys.index(key),
                )
            )
    units = {number.unit for numbers in of_runs for number in numbers.values()}
    return PlotPart(title=name.text, unit=_only(units), lines=tuple(lines))


def _overlaid(parts: Sequence[PlotPart]) -> PlotPart:
    """Merge all parts into one; each number gets its own color."""
    lines: list[PlotLine] = []
    for part in parts:
        first = max((line.colour for line in lines), default=-1) + 1
        lines += [
            PlotLine(
                label=" ".join(filter(None, (line.label, part.title))),
                times_s=line.times_s,
                values=line.values,
                run=line.run,
                colour=first + line.colour,
            )
            for line in part.lines
        ]
    title = ", ".join(part.title for part in parts)
    return PlotPart(title=title, unit=_only({part.unit for part in parts}), lines=tuple(lines))


def _only(units: set[str]) -> str:
    return units.pop() if len(units) == 1 else ""


WIDTH_IN: Final = 9.0
HEIGHT_IN: Final = 2.6
"""Height of one field's plot [inch]."""
_DPI: Final = 120
MOST_NAMED: Final = 12
"""Maximum number of lines in a legend."""
_STYLES: Final = ("-", "--", ":", "-.")
"""Line styles, by run."""


def check_time_range(parts: Sequence[PlotPart], xlim: tuple[float, float]) -> None:
    """Check that there is something to see.

    Args:
        parts: what is to be drawn.
        xlim: the times to show [s].

    Raises:
        MisuseError: no message is within the range.
    """
    if any(len(values) for part in parts for values in _shown(part, xlim)):
        return
    times_s = np.concatenate([line.times_s for part in parts for line in part.lines])
    first, last = (round(time_s, 3) + 0.0 for time_s in (times_s.min(), times_s.max()))
    raise MisuseError(
        f"`--xlim {xlim[0]:g} {xlim[1]:g}`: no message was published in this interval",
        help=f"the recorded messages span {first:g} s to {last:g} s",
    )


def draw(
    parts: Sequence[PlotPart],
    title: str,
    path: Path,
    xlim: tuple[float, float] | None = None,
) -> None:
    """Write a plot with the parts stacked; replaces the file as a whole.

    Args:
        parts: what to draw.
        title: title of the plot.
        path: output file, .png or .svg.
        xlim: time range to show [s]; None: all.

    Raises:
        CommandFailedError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN * len(parts) + 0.8), layout="constrained")
    axes = figure.subplots(len(parts), 1, sharex=True, squeeze=False)[:, 0]
    for axis, part in zip(axes, parts, strict=True):
        for line in part.lines:
            axis.plot(
                line.times_s,
                line.values,
                linewidth=1.0,
                label=line.label,
                color=f"C{line.colour}",
                linestyle=_STYLES[line.run % len(_STYLES)],
            )
        axis.set_ylabel(part.label, fontsize="small")
        axis.grid(visible=True, alpha=0.3)
        if len(part.lines) <= MOST_NAMED and any(line.label for line in part.lines):
            axis.legend(loc="upper right", fontsize="small")
    if xlim is not None:
        # An infinite limit shows everything on that side.
        axes[-1].set_xlim(*(limit if isfinite(limit) else None for limit in xlim))
        for axis, part in zip(axes, parts, strict=True):
            _fit(axis, part, xlim)
    axes[-1].set_xlabel("time since activation [s]")
    figure.suptitle(title, fontsize="medium")
    try:
        save_figure(figure, path)
    except OSError as error:
        raise unwritable(path, error) from error


def save_figure(figure: "Figure", path: Path) -> None:
    """Write a figure as PNG or SVG, depending on the extension; replaces the file as a whole.

    Equal figures give equal bytes, and the text of an SVG remains text.

    Raises:
        OSError: the file cannot be written.
    """
    import matplotlib

    picture, kind = BytesIO(), path.suffix.removeprefix(".")
    with matplotlib.rc_context({"svg.hashsalt": "obk", "svg.fonttype": "none"}):
        metadata = {"Date": None} if kind == "svg" else None
        figure.savefig(picture, format=kind, dpi=_DPI, metadata=metadata)
    write_bytes(path, picture.getvalue())


def _fit(axis: Any, part: PlotPart, xlim: tuple[float, float]) -> None:
    """Scale the axis of values to the visible values."""
    shown = [*_shown(part, xlim)]
    finite = np.concatenate([values[np.isfinite(values)] for values in shown] or [np.empty(0)])
    if len(finite):
        low, high = float(finite.min()), float(finite.max())
        margin = 0.05 * (high - low) or 0.05 * abs(high) or 1.0
        axis.set_ylim(low - margin, high + margin)


def _shown(part: PlotPart, xlim: tuple[float, float]) -> Iterator[Floats]:
    for line in part.lines:
        yield line.values[(line.times_s >= xlim[0]) & (line.times_s <= xlim[1])]


def write_page(
    parts: Sequence[PlotPart],
    title: str,
    path: Path,
    xlim: tuple[float, float] | None = None,
) -> None:
    """Write the page; replaces the file as a whole.

    Args:
        parts: what to draw, one below the other.
        title: title of the page.
        path: output file.
        xlim: time range to show first [s]; None: all.

    Raises:
        CommandFailedError: the file cannot be written.
    """
    data = {
        "parts": [
            {"label": part.label, "lines": [_line(line) for line in part.lines]} for part in parts
        ],
        "xlim": xlim,
    }
    texts = {
        "TITLE": escape(title),
        "STYLE": _asset("uPlot.min.css") + _asset("plot.css"),
        "DATA": json.dumps(data).replace("<", "\\u003c"),
        "LICENCE": _asset("uPlot.LICENSE"),
        "LIBRARY": _asset("uPlot.iife.min.js"),
        "SCRIPT": _asset("plot.js"),
    }
    page = _asset("plot.html")
    for name, text in texts.items():
        page = page.replace(f"@{name}@", text)
    try:
        write_bytes(path, page.encode())
    except OSError as error:
        raise unwritable(path, error) from error


def _asset(name: str) -> str:
    return files("obk_cli.record").joinpath("page", name).read_text(encoding="utf-8")


def packed_line(
    times: Sequence[Floats], values: Sequence[Floats], most: int = MOST_POINTS
) -> dict[str, str]:
    """`times` and `values` of a line for a page, as base64 of 64-bit floats.

    Args:
        times: in parts of shape `(n,)`.
        values: in parts of the same lengths.
        most: maximum number of points for the page.
    """
    few_times, few_values = _thinned(np.concatenate(times), np.concatenate(values), most)
    return {"times": _packed(few_times), "values": _packed(few_values)}


def _line(line: PlotLine) -> dict[str, Any]:
    return {
        "label": line.label,
        "run": line.run,
        "colour": line.colour,
        "points": len(line.times_s),
        **packed_line([line.times_s], [line.values]),
    }


def _packed(numbers: Floats) -> str:
    return base64.b64encode(np.ascontiguousarray(numbers, "<f8").tobytes()).decode()


def _thinned(times: Floats, values: Floats, most: int) -> tuple[Floats, Floats]:
    """A line of at most `most` points: the minimum and maximum of each interval of points."""
    if len(times) <= most:
        return times, values
    size = -(-len(times) // (most // 2))
    count = -(-len(times) // size)
    padded = np.full(count * size, np.nan)
    padded[: len(values)] = values
    spans = padded.reshape(count, size)
    least = np.where(np.isnan(spans), np.inf, spans).argmin(axis=1)
    greatest = np.where(np.isnan(spans), -np.inf, spans).argmax(axis=1)
    begins = np.arange(count) * size
    kept = np.unique(np.concatenate([begins + least, begins + greatest]))
    return times[kept], values[kept]
