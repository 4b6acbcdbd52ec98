"""`obk export FILE|RUN --to parquet|csv`: recorded topics as tables for other programs."""

import os
import sys
from pathlib import Path
from typing import Annotated, Literal, cast

import typer

from obelisk_recordings.find import find_recording
from obk_cli.cli.options import RunArgument, TopicsOption, require_choice
from obk_cli.runs.folder import runs_folder

__all__ = ["EXAMPLE", "command"]

EXAMPLE = """\b
Example: obk export dummy --to parquet
         obk export dummy.mcap --to csv --topic est --topic ctrl --output tables
"""


def command(
    recording: RunArgument,
    to: Annotated[str, typer.Option(metavar="parquet|csv", help="Format of the files.")],
    topic: TopicsOption = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="DIR", help="Output folder. Default: one named after the run."
        ),
    ] = None,
) -> None:
    """Convert recorded topics to Parquet or CSV, one file per topic.

    Each row is a message: `t` in seconds since the stack became active, the times of publication
    and receipt, and one column per field. Parquet keeps arrays, units and joint names. In CSV each
    array element is a column named after its joint. ROS is not needed.
    """
    require_choice("--to", to, ("parquet", "csv"))

    from obk_cli.optional_deps import require_extra

    require_extra("pyarrow", "export")
    require_extra("mcap", "export")

    from obelisk_recordings.run import open_run, topic_named
    from obelisk_spec.suggestions import with_number
    from obk_cli.record.export import export_run

    run = open_run(find_recording(runs_folder(os.environ), recording))
    if not run.bag.is_complete:
        print(f"note: {run.path} is incomplete: its recorder did not close it", file=sys.stderr)
    topics = [topic_named(name, run.topics) for name in topic or run.topics]
    form = cast(Literal["parquet", "csv"], to)
    for written in export_run(run, topics, form, output or Path(run.name)):
        print(f"{written.path}  {with_number(written.count, 'message')}")
