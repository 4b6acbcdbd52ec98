"""`obk plot FILE|RUN TOPIC.FIELD...`: fields of a recording as a picture."""

import os
import re
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.record.plot import PlotField, parse_field, resolve_topic
from obk_cli.record.recording import find_recording
from obk_cli.runs.folder import runs_folder

__all__ = ["EXAMPLE", "command"]

EXAMPLE = """\b
Example: obk plot dummy est.q_joints ctrl.u_mujoco[0]
         obk plot dummy.mcap /obelisk/dummy/imu.angular_velocity -o imu.svg
"""


def command(
    recording: Annotated[
        str,
        typer.Argument(metavar="FILE|RUN", help="A file, or a run by its config's name."),
    ],
    fields: Annotated[
        list[str],
        typer.Argument(metavar="TOPIC.FIELD...", help="The topic in full, or the end of it."),
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="The picture, .png or .svg."),
    ] = None,
    received: Annotated[
        bool, typer.Option("--received", help="Draw over the time of receipt.")
    ] = False,
) -> None:
    """Draw fields of a recording over time, as PNG or SVG.

    A field is a number, an array (a line for each number) or a message in the message (a line for
    each number in it). Time is that at which the messages were published, with --received that at
    which the recorder got them. No ROS is needed: the recording itself defines how its messages are
    read.
    """
    from obk_cli.optional_deps import require_extra

    require_extra("mcap_ros2", "plot")
    require_extra("matplotlib", "plot")

    from obelisk_recordings.summary import read_bag
    from obk_cli.record.plot import FORMATS, draw

    names = [parse_field(text) for text in fields]
    path = find_recording(runs_folder(os.environ), recording)
    picture = output or Path(f"{_stem(path)}_{_word(names[0].text)}.png")
    if picture.suffix not in FORMATS:
        raise MisuseError(f"`--output {picture}`: expected a file named .png or .svg")
    bag = read_bag(path)
    if not bag.is_complete:
        print(f"note: {path} breaks off: its recorder did not end it", file=sys.stderr)
    topics = [topic.topic for topic in bag.topics]
    drawn = [PlotField(replace(name, topic=resolve_topic(name.topic, topics))) for name in names]
    _fill(path, bag.start_ns or 0, drawn, by_receipt=received)
    draw(drawn, _stem(path), picture)
    print(picture)


def _fill(path: Path, start_ns: int, drawn: Sequence[PlotField], *, by_receipt: bool) -> None:
    """Read the lines of every field, all in one pass."""
    from obk_cli.record.mcap_reader import messages_of

    for message in messages_of(path, {lines.name.topic for lines in drawn}):
        time_ns = message.received_ns if by_receipt else message.published_ns
        for lines in drawn:
            if lines.name.topic == message.topic:
                lines.add((time_ns - start_ns) * 1e-9, message.value)
    for lines in drawn:
        if not lines.lines:
            raise CommandFailedError(f"`{lines.name.text}`: no number was recorded")


def _stem(path: Path) -> str:
    """A run's recording is called after the run."""
    return path.parent.name if path.stem == "recording" else path.stem


def _word(field: str) -> str:
    """A field's name as part of a file's."""
    return re.sub(r"\W+", "_", field).strip("_")
