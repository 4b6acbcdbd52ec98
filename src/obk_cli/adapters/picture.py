"""Draws lines over time into a picture, PNG or SVG, with matplotlib; opens no window."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Final

from obk_cli.adapters.files import unwritable
from obk_cli.files import write_bytes
from obk_cli.recording.fields import Lines

__all__ = ["FORMATS", "draw"]

FORMATS: Final = (".png", ".svg")
WIDTH_IN: Final = 9.0
HEIGHT_IN: Final = 2.6
"""Of one field's part [inch]."""
DPI: Final = 120
MOST_NAMED: Final = 12
"""Lines that a legend has room for."""


def draw(fields: Sequence[Lines], title: str, path: Path) -> None:
    """Write a picture with one part for each field, one below the other; whole or not at all.

    Raises:
        CommandFailedError: the file cannot be written.
    """
    import matplotlib
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN * len(fields) + 0.8), layout="constrained")
    parts = figure.subplots(len(fields), 1, sharex=True, squeeze=False)
    for part, field in zip(parts[:, 0], fields, strict=True):
        for line in field.lines:
            part.plot(line.times_s, line.values, linewidth=1.0, label=line.label)
        part.set_ylabel(field.name.text, fontsize="small")
        part.grid(visible=True, alpha=0.3)
        if 1 < len(field.lines) <= MOST_NAMED:
            part.legend(loc="upper right", fontsize="small")
    parts[-1, 0].set_xlabel("time since the begin of the recording [s]")
    figure.suptitle(title, fontsize="medium")
    # The same recording gives the same bytes, and text stays text.
    picture, kind = BytesIO(), path.suffix.removeprefix(".")
    with matplotlib.rc_context({"svg.hashsalt": "obk", "svg.fonttype": "none"}):
        metadata = {"Date": None} if kind == "svg" else None
        figure.savefig(picture, format=kind, dpi=DPI, metadata=metadata)
    try:
        write_bytes(path, picture.getvalue())
    except OSError as error:
        raise unwritable(path, error) from error
