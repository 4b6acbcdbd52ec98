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
    array element is a column named after its joint. ROS is not needed. A recording that was not
    closed, for example because its recorder was killed, is exported up to its last message, with a
    warning.
    """
    require_choice("--to", to, ("parquet", "csv"))

    from obk_cli.optional_deps import require_extra

    require_extra("pyarrow", "export")
    require_extra("mcap", "export")

    from obelisk_recordings.run import open_run, topic_named
    from obelisk_spec.suggestions import list_names, with_number
    from obk_cli.record.export import export_run

    run = open_run(find_recording(runs_folder(os.environ), recording))
    topics = [topic_named(name, run.topics) for name in topic or run.topics]
    form = cast(Literal["parquet", "csv"], to)
    silent = set(topics if topic else ())
    for written in export_run(run, topics, form, output or Path(run.name)):
        silent.discard(written.topic)
        print(f"{written.path}  {with_number(written.count, 'message')}")
    if silent:
        print(f"warning: no messages of {list_names(sorted(silent))}", file=sys.stderr)
    if not run.bag.is_complete and run.bag.end_ns is not None:
        end_s = (run.bag.end_ns - run.origin_ns) / 1_000_000_000
        print(
            f"warning: {run.path} is incomplete: its recorder did not close it; "
            f"the last message is at t = {end_s:.3f} s",
            file=sys.stderr,
        )
