"""`obk record [TOPIC...]`: topics of a running stack to an MCAP file."""

import os
import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from obelisk_spec.suggestions import list_names
from obk_cli.cli.options import require_positive
from obk_cli.clock import local_time
from obk_cli.errors import EXIT_FAILED, CommandFailedError, MisuseError
from obk_cli.introspect.resolve import absolute, matching_names
from obk_cli.introspect.target import with_run_types
from obk_cli.record.recorder_job import (
    RecorderJob,
    RecordRequest,
    RunMetadata,
    file_name,
    run_metadata_of,
)
from obk_cli.ros.environment import ros_environment
from obk_cli.runs.folder import runs_folder, topics_of_run
from obk_cli.runs.registry import select_runs

__all__ = ["EXAMPLE", "command", "request_of"]

EXAMPLE = """\b
Example: obk record --duration 10
         obk record '/obelisk/dummy/*' --exclude '*imu' --output dummy.mcap
"""


def command(
    topics: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[TOPIC...]", help="Topic names or patterns. Default: the topics of the config."
        ),
    ] = None,
    all_: Annotated[
        bool, typer.Option("--all", help="Record every topic of the ROS domain.")
    ] = False,
    exclude: Annotated[
        list[str] | None,
        typer.Option(metavar="PATTERN", help="Leave out these topics; may be repeated."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Output file.")
    ] = None,
    run: Annotated[
        str | None, typer.Option(metavar="RUN", help="Stack to record, if several are running.")
    ] = None,
    duration: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Stop after this time [s].")
    ] = None,
) -> None:
    """Record topics of a running stack to an MCAP file that Foxglove and `ros2 bag` can read.

    By default, the command records the topics in the config of the running stack in this ROS
    domain. The file starts with the compiled config and its hash, software versions, and the
    parameters with which the nodes were launched. Recording ends on Ctrl-C, on SIGTERM or after
    --duration. After a crash, the file is readable except for the last 0.25 s. The exit code is 1
    if no message was recorded.
    """
    require_positive("--duration", duration, "a number of seconds")

    from obk_cli.optional_deps import require_extra

    require_extra("mcap", "record")

    from obk_cli.record.recorder import record, recorded_text

    environment = ros_environment()
    for note in environment.notes:
        print(f"warning: {note}", file=sys.stderr)
    folder = _stack(run, environment.domain, is_needed=not (topics or all_))
    with_run_types(environment, folder).put_into_effect()
    known = topics_of_run(folder) if folder else {}
    request = request_of(topics or [], known, every=all_)
    background = run_metadata_of(folder) if folder else RunMetadata()
    job = RecorderJob(
        path=output or Path(file_name(folder, local_time())),
        request=replace(request, excludes=tuple(exclude or ())),
        metadata=background.metadata,
        attachments=background.attachments,
        duration_s=duration,
    )
    recorded = record(job, lambda text: print(text, file=sys.stderr))
    print(recorded_text(recorded))
    if not any(counter.count for counter in recorded.counters.values()):
        raise typer.Exit(EXIT_FAILED)


def _stack(name: str | None, domain: int, *, is_needed: bool) -> Path | None:
    """Folder of the run to record; None if no stack is running and none is needed."""
    runs = select_runs(runs_folder(os.environ), name, domain=domain)
    if len(runs) > 1 and is_needed:
        names = ", ".join(run.name for run in runs.values())
        raise MisuseError(
            f"several stacks are running in ROS domain {domain}: {names}",
            help="select one with `--run`, or name the topics",
        )
    if not runs and is_needed:
        raise CommandFailedError(
            f"no stack is running in ROS domain {domain} on this host",
            help="name the topics, or record all of them with `--all`",
        )
    return next(iter(runs)) if len(runs) == 1 else None


def request_of(
    given: Sequence[str], known: Mapping[str, str | None], *, every: bool = False
) -> RecordRequest:
    """What to record; the recorder waits for topics that are named without a pattern.

    Args:
        given: full names, suffixes of known names, and patterns; empty: all known topics.
        known: the stack's topics, with their types as far as they are known.
        every: record all topics of the ROS domain.

    Raises:
        MisuseError: a suffix fits several known topics.
    """
    patterns = tuple(topic for topic in given if any(sign in topic for sign in "*?["))
    names = [_full_name(topic, known) for topic in given if topic not in patterns]
    requested = {name: known.get(name) for name in names} if given or every else known
    return RecordRequest(topics=requested, patterns=("*",) if every else patterns)


def _full_name(topic: str, known: Collection[str]) -> str:
    fitting = matching_names(topic, known)
    if len(fitting) > 1:
        raise MisuseError(f"`{topic}` is ambiguous", help=f"choose one of {list_names(fitting)}")
    return fitting[0] if fitting else absolute(topic)
