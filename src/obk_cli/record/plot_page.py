"""Write plots as one file for the browser, with zoom, a cursor and no network.

`page/uPlot.iife.min.js` draws them: version 1.6.32 of uPlot, unchanged, under the MIT licence in
`page/uPlot.LICENSE`.
"""

import base64
import json
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from obk_cli.files import unwritable, write_bytes
from obk_cli.record.plot import PlotLine, PlotPart

__all__ = ["packed_line", "write_page"]

MOST_POINTS: Final = 100_000
"""Of a line; of a longer one the page has the extremes of so many spans."""
Floats = NDArray[np.float64]


def write_page(
    parts: Sequence[PlotPart],
    title: str,
    path: Path,
    xlim: tuple[float, float] | None = None,
) -> None:
    """Write the page, whole or not at all.

    Args:
        parts: what to draw, one below the other.
        title: above all.
        path: of the file.
        xlim: which times are shown first [s]; None: all.

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
        times: in parts, each of shape `(n,)`.
        values: in parts of the same lengths.
        most: how many points the page gets at most.
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
    """A line of at most `most` points: the least and the greatest value of each span of points."""
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
