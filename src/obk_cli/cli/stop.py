"""`obk stop [RUN]`: shut down stacks that are running on this host."""

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from obk_cli.cli.options import require_positive
from obk_cli.errors import EXIT_DONE, EXIT_FAILED, CommandFailedError, MisuseError
from obk_cli.runs.folder import Run, read_run, runs_folder
from obk_cli.runs.registry import end_launcher, select_runs
from obk_cli.terminal import plain

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: obk stop dummy"
WAIT_S = 30.0


def command(
    run: Annotated[
        str | None,
        typer.Argument(metavar="[RUN]", help="Stack, by the name of its config or run folder."),
    ] = None,
    all_: Annotated[bool, typer.Option("--all", help="Stop every stack on this host.")] = False,
    timeout: Annotated[
        float, typer.Option(metavar="SECONDS", help="Seconds to wait for a stack to stop.")
    ] = WAIT_S,
    kill: Annotated[
        bool, typer.Option("--kill", help="Kill a launcher that does not stop in time.")
    ] = False,
) -> None:
    """Shut a stack down cleanly, as Ctrl-C in its own terminal does, and wait until it has stopped.

    RUN is required if several stacks are running. Exit code 0: the stack has stopped, even if it
    failed; 1: it did not stop, or no stack is running.
    """
    if all_ and run is not None:
        raise MisuseError("`obk stop` takes RUN or `--all`, not both")
    require_positive("--timeout", timeout, "a number of seconds")
    runs = select_runs(runs_folder(os.environ), run)
    if not all_:
        _require_one(runs)
    ends = [_stop(folder, run_, timeout, may_kill=kill) for folder, run_ in runs.items()]
    raise typer.Exit(EXIT_DONE if all(ends) else EXIT_FAILED)


def _require_one(runs: Mapping[Path, Run]) -> None:
    if not runs:
        raise CommandFailedError(
            "no stack is running on this host", help="start one with `obk launch`"
        )
    if len(runs) > 1:
        names = [run.name for run in runs.values()]
        # Stacks of the same name are shown by their folders.
        shown = names if len(set(names)) == len(names) else [folder.name for folder in runs]
        raise MisuseError(
            f"several stacks are running on this host: {', '.join(sorted(shown))}",
            help="name one of them, or add `--all`",
        )


def _stop(folder: Path, run: Run, timeout_s: float, *, may_kill: bool) -> bool:
    """Stop one stack and print the result; return whether it has stopped."""
    end = end_launcher(
        folder, run, reason="requested by `obk stop`", timeout_s=timeout_s, may_kill=may_kill
    )
    if end == "running":
        hint = "" if may_kill else "; use `--kill` to kill it"
        print(
            f"error: {run.name} (launcher {run.pid}) did not stop within {timeout_s:g} s{hint}",
            file=sys.stderr,
        )
        return False
    ended = read_run(folder)
    if end == "killed":
        print(f"{run.name}: killed")
    elif ended and ended.cause:
        print(f"{run.name}: stopped after a failure: {plain(ended.cause)}")
    else:
        print(f"{run.name}: ended")
    return True
