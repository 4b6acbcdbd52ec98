"""`obk bag info [FILE|RUN]`: what a recording contains."""

import json
import os
from collections.abc import Iterator
from dataclasses import asdict
from datetime import datetime
from typing import Annotated, Any

import typer

from obelisk_recordings.bag import Bag, BagTopic
from obelisk_recordings.find import find_recording
from obk_cli.cli.options import FormatOption, wants_json
from obk_cli.runs.folder import runs_folder
from obk_cli.terminal import plain

__all__ = ["bag_data", "bag_text"]


def bag_data(bag: Bag) -> dict[str, Any]:
    """The recording as JSON data; rates in hertz."""
    topics = [{**asdict(topic), "rate_hz": _rate_hz(bag, topic)} for topic in bag.topics]
    return {**asdict(bag), "duration_s": bag.duration_s, "count": bag.count, "topics": topics}


def bag_text(bag: Bag) -> Iterator[str]:
    """Lines of text output."""
    yield f"{plain(bag.path)}: MCAP, profile {plain(bag.profile) or '-'}, {_size(bag.size_bytes)}"
    if not bag.is_complete:
        yield (
            "incomplete: its recorder did not close it, so the index and the last messages may be "
            "missing"
        )
    if bag.start_ns is not None:
        start = datetime.fromtimestamp(bag.start_ns * 1e-9)
        yield f"{bag.count} messages in {bag.duration_s:.3f} s from {start:%Y-%m-%d %H:%M:%S.%f}"
    else:
        yield "no messages"
    width = max((len(topic.topic) for topic in bag.topics), default=0)
    kinds = max((len(topic.msg_type) for topic in bag.topics), default=0)
    for topic in bag.topics:
        yield plain(
            f"  {topic.topic:<{width}}  {topic.msg_type:<{kinds}}  {topic.count:>8}  "
            f"{_rate_hz(bag, topic):8.1f} Hz{_lost(topic)}"
        )
    for name, values in bag.metadata.items():
        yield f"{plain(name)}:"
        yield from (f"  {plain(key)}: {plain(value)}" for key, value in values.items())
    if bag.attachments:
        yield "attachments:"
        yield from (f"  {plain(name)}  {_size(size)}" for name, size in bag.attachments.items())


def _rate_hz(bag: Bag, topic: BagTopic) -> float:
    """The mean rate over the whole recording [Hz]."""
    return topic.count / bag.duration_s if bag.duration_s > 0 else 0.0


def _lost(topic: BagTopic) -> str:
    return f"  {topic.lost} LOST" if topic.lost else ""


def _size(count: int) -> str:
    if count < 10_000:
        return f"{count} bytes"
    return f"{count / 1e3:.0f} kB" if count < 10_000_000 else f"{count / 1e6:.1f} MB"


app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Show what a recording contains.",
)

EXAMPLE = "Example: obk bag info dummy.mcap --format json"


@app.callback(epilog=EXAMPLE)
def _root() -> None:
    """Inspect recordings."""


@app.command(epilog=EXAMPLE)
def info(
    recording: Annotated[
        str | None,
        typer.Argument(metavar="[FILE|RUN]", help="File, or the name of a run's folder or config."),
    ] = None,
    format: FormatOption = "text",
) -> None:
    """Show topics, types, counts, rates and losses of a recording.

    It also shows where the recording comes from: the run, the config and the versions.

    The default is the latest recorded run. The command also reads rosbag2 recordings, and
    incomplete recordings up to the point where the recorder was killed.
    """
    is_json = wants_json(format)

    from obk_cli.optional_deps import require_extra

    require_extra("mcap", "record")

    from obelisk_recordings.summary import read_bag

    bag = read_bag(find_recording(runs_folder(os.environ), recording))
    if is_json:
        print(json.dumps(bag_data(bag), indent=1))
        return
    print("\n".join(bag_text(bag)))
