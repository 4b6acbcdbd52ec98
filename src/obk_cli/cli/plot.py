"""`obk plot FILE|RUN... TOPIC.FIELD...`: fields of recorded runs as a picture or a page."""

import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Final

import typer

from obelisk_recordings.find import find_recording
from obk_cli.errors import MisuseError
from obk_cli.runs.folder import runs_folder

__all__ = ["EXAMPLE", "command"]

EXAMPLE = """\b
Example: obk plot dummy est.q_joints ctrl.u_mujoco[0]
         obk plot before.mcap after.mcap est.q_joints --xlim 0 2 --html
         obk plot dummy est.q_joints[0] ctrl.u_mujoco[0] --overlay -o arm.svg
"""
FORMATS: Final = (".png", ".svg", ".html")


def command(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE|RUN... TOPIC.FIELD...",
            help="Files, or runs by their configs' names; then fields of topics, which are given "
            "in full or by their end.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="The file, .png, .svg or .html."),
    ] = None,
    html: Annotated[
        bool, typer.Option("--html", help="Write a page with zoom and cursor, not a PNG.")
    ] = False,
    overlay: Annotated[
        bool, typer.Option("--overlay", help="Draw all fields in one plot.")
    ] = False,
    xlim: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="FROM TO", help="Show these times only [s]."),
    ] = None,
    received: Annotated[
        bool, typer.Option("--received", help="Draw over the time of receipt.")
    ] = False,
) -> None:
    """Draw fields of recorded runs over time, as PNG, SVG or a page for the browser.

    A field is a number, an array (a line for each number, called after its joint) or a message in
    the message (a line for each number in it). Several runs are drawn over each other. Time is that
    at which the messages were published, with --received that at which the recorder got them; it
    begins when the stack became active. No ROS is needed: the recording itself defines how its
    messages are read.
    """
    from obk_cli.optional_deps import require_extra

    require_extra("mcap", "plot")
    require_extra("matplotlib", "plot")

    from obelisk_recordings.run import open_run
    from obk_cli.record.plot import draw, parse_field, plot_parts
    from obk_cli.record.plot_page import write_page

    recordings, texts = _runs_and_fields(words)
    names = [parse_field(text) for text in texts]
    if xlim is not None and not xlim[0] < xlim[1]:
        raise MisuseError(f"`--xlim {xlim[0]:g} {xlim[1]:g}`: expected the lesser time first")
    parent = runs_folder(os.environ)
    paths = [find_recording(parent, name) for name in recordings]
    ending = ".html" if html else ".png"
    runs = [open_run(path) for path in paths]
    picture = output or Path(f"{runs[0].name}_{_word(names[0].text)}{ending}")
    if picture.suffix not in FORMATS or (html and picture.suffix != ".html"):
        expected = ".html" if html else ".png, .svg or .html"
        raise MisuseError(f"`--output {picture}`: expected a file named {expected}")
    for run in runs:
        if not run.bag.is_complete:
            print(f"note: {run.path} breaks off: its recorder did not end it", file=sys.stderr)
    parts = plot_parts(runs, names, by_receipt=received, overlay=overlay)
    title = ", ".join(run.name for run in runs)
    write = write_page if picture.suffix == ".html" else draw
    write(parts, title, picture, xlim)
    print(picture)


def _runs_and_fields(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """The recordings and the fields; the first word is a recording, and so is every file.

    Raises:
        MisuseError: there is no field.
    """
    is_run = [
        place == 0 or "." not in word or os.path.exists(word)  # noqa: PTH110  (`Path.exists` raises)
        for place, word in enumerate(words)
    ]
    runs = [word for word, one in zip(words, is_run, strict=True) if one]
    fields = [word for word, one in zip(words, is_run, strict=True) if not one]
    if not fields:
        raise MisuseError(
            f"`{words[-1]}` names no field",
            help="expected TOPIC.FIELD behind the recordings, such as est.q_joints[0]",
        )
    return runs, fields


def _word(field: str) -> str:
    """A field's name as part of a file's."""
    return re.sub(r"\W+", "_", field).strip("_")
