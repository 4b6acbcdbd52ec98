"""`obk plot FILE|RUN... TOPIC.FIELD...`: fields of recorded runs as a plot or a page."""

import os
import re
from collections.abc import Sequence
from math import inf
from pathlib import Path
from typing import Annotated, Final

import typer

from obelisk_recordings.find import find_recording
from obk_cli.cli.options import note_if_incomplete
from obk_cli.errors import MisuseError
from obk_cli.files import path_exists
from obk_cli.runs.folder import runs_folder

__all__ = ["EXAMPLE", "command"]

EXAMPLE = """\b
Example: obk plot dummy est.q_joints ctrl.u_mujoco[0]
         obk plot before.mcap after.mcap est.q_joints --xlim 0 2 --html
         obk plot dummy est.q_joints[0] ctrl.u_mujoco[0] --overlay -o arm.svg
"""
FORMATS: Final = (".png", ".svg", ".html")
_LATEST_S: Final = 1e9


def command(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE|RUN... TOPIC.FIELD...",
            help="Files, or names of run folders or configs; then fields of topics. A "
            "config stands for its latest recorded run, and `NAME~1` for the one before. "
            "A topic is given by its name or a suffix of it.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Output file: .png, .svg or .html."),
    ] = None,
    html: Annotated[
        bool, typer.Option("--html", help="Write a page with zoom and cursor instead of a PNG.")
    ] = False,
    overlay: Annotated[
        bool, typer.Option("--overlay", help="Plot all fields in the same axes.")
    ] = False,
    xlim: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="FROM TO", help="Show only this time range [s]."),
    ] = None,
    received: Annotated[bool, typer.Option("--received", help="Use the times of receipt.")] = False,
) -> None:
    """Plot fields of recorded runs over time, as PNG, SVG or an HTML page.

    A field is a number, an array (one line per element, named after its joint) or a nested message
    (one line per number). Several runs are drawn in the same plot. Time 0 is when the stack became
    active. Messages are drawn at their time of publication; with --received, at their time of
    receipt. ROS is not needed, because recordings contain the definitions of their messages.
    """
    from obk_cli.optional_deps import require_extra

    require_extra("mcap", "plot")
    require_extra("matplotlib", "plot")

    from obelisk_recordings.run import open_run
    from obk_cli.record.plot import check_time_range, draw, parse_field, plot_parts, write_page

    recordings, texts = _runs_and_fields(words)
    names = [parse_field(text) for text in texts]
    if xlim is not None and not xlim[0] < xlim[1]:
        raise MisuseError(f"`--xlim {xlim[0]:g} {xlim[1]:g}`: expected the earlier time first")
    if xlim is not None and any(_LATEST_S < abs(limit) < inf for limit in xlim):
        raise MisuseError(f"`--xlim {xlim[0]:g} {xlim[1]:g}`: expected times up to {_LATEST_S:g} s")
    parent = runs_folder(os.environ)
    paths = [find_recording(parent, name) for name in recordings]
    ending = ".html" if html else ".png"
    runs = [open_run(path) for path in paths]
    picture = output or Path(f"{runs[0].name}_{_word(names[0].text)}{ending}")
    if picture.suffix not in FORMATS or (html and picture.suffix != ".html"):
        expected = ".html" if html else ".png, .svg or .html"
        raise MisuseError(f"`--output {picture}`: expected a file name that ends in {expected}")
    for run in runs:
        note_if_incomplete(run)
    parts = plot_parts(runs, names, by_receipt=received, overlay=overlay)
    if xlim is not None:
        check_time_range(parts, xlim)
    title = ", ".join(run.name for run in runs)
    write = write_page if picture.suffix == ".html" else draw
    write(parts, title, picture, xlim)
    print(picture)


def _runs_and_fields(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Split the words into recordings and fields; the first word and every file are recordings.

    Raises:
        MisuseError: no field is given.
    """
    is_run = [
        place == 0 or "." not in word or path_exists(word) for place, word in enumerate(words)
    ]
    runs = [word for word, one in zip(words, is_run, strict=True) if one]
    fields = [word for word, one in zip(words, is_run, strict=True) if not one]
    if not fields:
        raise MisuseError(
            f"`{words[-1]}` does not name a field",
            help="expected TOPIC.FIELD after the recordings, such as est.q_joints[0]",
        )
    return runs, fields


def _word(field: str) -> str:
    """A field's name as part of a file name."""
    return re.sub(r"\W+", "_", field).strip("_")
