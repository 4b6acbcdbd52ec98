"""`obk record [TOPIC...]`: topics of a running stack into an MCAP file."""

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from obk_cli.cli.options import require_positive
from obk_cli.clock import local_time
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.introspect.target import with_run_types
from obk_cli.record.recorder_job import RecorderJob, RecordRequest
from obk_cli.record.recording import RunMetadata, file_name, run_metadata_of
from obk_cli.ros.environment import ros_environment
from obk_cli.runs.folder import runs_folder, topics_of_run
from obk_cli.runs.registry import select_runs

__all__ = ["EXAMPLE", "command"]

EXAMPLE = """\b
Example: obk record --duration 10
         obk record '/obelisk/dummy/*' --exclude '*imu' --output dummy.mcap
"""


def command(
    topics: Annotated[
        list[str] | None,
        typer.Argument(metavar="[TOPIC...]", help="Names or patterns; else those of the config."),
    ] = None,
    all_: Annotated[bool, typer.Option("--all", help="Every topic of the ROS domain.")] = False,
    exclude: Annotated[
        list[str] | None,
        typer.Option(metavar="PATTERN", help="Leave these out; may be repeated."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="The file to write.")
    ] = None,
    run: Annotated[
        str | None, typer.Option(metavar="RUN", help="Of several stacks, this one.")
    ] = None,
    duration: Annotated[float | None, typer.Option(help="Seconds after which to end.")] = None,
) -> None:
    """Record topics of a running stack into an MCAP file that Foxglove and `ros2 bag` read.

    Without TOPIC those of the config of the stack that runs in this ROS domain. Its config as
    compiled, hash, versions and parameters stand first in the file. Ends on Ctrl-C, on SIGTERM or
    after --duration; after any other end the file can be read up to its last quarter of a second.
    """
    require_positive("--duration", duration, "seconds")

    from obk_cli.optional_deps import require_extra

    require_extra("mcap", "record")

    from obk_cli.record.recorder import record, recorded_text

    environment = ros_environment()
    for note in environment.notes:
        print(f"warning: {note}", file=sys.stderr)
    folder = _stack(run, environment.domain, is_needed=not (topics or all_))
    with_run_types(environment, folder).put_into_effect()
    request = _request(topics or [], folder, every=all_)
    background = run_metadata_of(folder) if folder else RunMetadata()
    job = RecorderJob(
        path=output or Path(file_name(folder, local_time())),
        request=replace(request, excludes=tuple(exclude or ())),
        metadata=background.metadata,
        attachments=background.attachments,
        duration_s=duration,
    )
    print(recorded_text(record(job, lambda text: print(text, file=sys.stderr))))


def _stack(name: str | None, domain: int, *, is_needed: bool) -> Path | None:
    """The folder of the run that is recorded; None where none runs here and none is needed."""
    runs = select_runs(runs_folder(os.environ), name, domain=domain)
    if len(runs) > 1 and is_needed:
        names = ", ".join(run.name for run in runs.values())
        raise MisuseError(
            f"several stacks run in the ROS domain {domain}: {names}",
            help="name one with `--run`, or the topics",
        )
    if not runs and is_needed:
        raise CommandFailedError(
            f"no stack runs in the ROS domain {domain} on this host",
            help="name the topics, or record every one with `--all`",
        )
    return next(iter(runs)) if len(runs) == 1 else None


def _request(topics: list[str], folder: Path | None, *, every: bool) -> RecordRequest:
    """What is asked for; names without a pattern are waited for."""
    patterns = tuple(topic for topic in topics if any(sign in topic for sign in "*?["))
    names = [_absolute(topic) for topic in topics if topic not in patterns]
    known = topics_of_run(folder) if folder else {}
    requested = {name: known.get(name) for name in names} if topics or every else known
    return RecordRequest(topics=requested, patterns=("*",) if every else patterns)


def _absolute(topic: str) -> str:
    return topic if topic.startswith("/") else f"/{topic}"
