"""`obk bag info [FILE|RUN]`: what a recording holds."""

import json
import os
from typing import Annotated

import typer

from obk_cli.cli.text_or_json import FormatOption, wants_json
from obk_cli.record.recording import find_recording
from obk_cli.report.bag import bag_data, bag_text
from obk_cli.runs.folder import runs_folder

__all__ = ["app"]

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Show what a recording holds.",
)

EXAMPLE = "Example: obk bag info dummy.mcap --format json"


@app.callback(epilog=EXAMPLE)
def _root() -> None:
    """Look into recordings."""


@app.command(epilog=EXAMPLE)
def info(
    recording: Annotated[
        str | None,
        typer.Argument(
            metavar="[FILE|RUN]", help="A file, or a run by its config's or folder's name."
        ),
    ] = None,
    format: FormatOption = "text",
) -> None:
    """Show topics, types, counts, rates and losses of a recording.

    Also what it was made from: the run, the config, the versions.

    Without FILE or RUN the newest run that was recorded. Reads recordings of rosbag2 too, and those
    whose recorder was killed, as far as they go.
    """
    is_json = wants_json(format)

    from obk_cli.optional_deps import require_extra

    require_extra("mcap_ros2", "record")

    from obk_cli.record.mcap_reader import read_bag

    bag = read_bag(find_recording(runs_folder(os.environ), recording))
    if is_json:
        print(json.dumps(bag_data(bag), indent=1))
        return
    print("\n".join(bag_text(bag)))
