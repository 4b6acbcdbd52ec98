"""`obk reap`: terminate processes that outlived their launcher."""

import os
import sys
from typing import Annotated

import typer

from obk_cli.errors import EXIT_DONE, EXIT_FAILED
from obk_cli.process.shared_memory import remove_dead_segments
from obk_cli.runs.folder import runs_folder
from obk_cli.runs.orphans import end_orphans, find_orphans
from obk_cli.terminal import plain

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: obk reap --dry-run"


def command(
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="List the processes without terminating them.")
    ] = False,
) -> None:
    """Terminate processes left over from stacks whose launcher has exited, and their children.

    The command affects only your own processes that `obk launch` started, and never a running
    stack. Exit code 0: no process is left; 1: a process is still running.
    """
    orphans = find_orphans(runs_folder(os.environ))
    verb = "would terminate" if dry_run else "terminating"
    for orphan in orphans:
        print(plain(f"{verb} {orphan.pid}  {orphan.run}  {orphan.command}"))
    if not orphans:
        print("no orphaned processes")
    if dry_run:
        raise typer.Exit(EXIT_DONE)
    remaining = end_orphans(orphans)
    if orphans:
        remove_dead_segments()
    for orphan in remaining:
        print(f"error: process {orphan.pid} is still running", file=sys.stderr)
    raise typer.Exit(EXIT_FAILED if remaining else EXIT_DONE)
