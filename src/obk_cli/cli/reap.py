"""`obk reap`: ends processes that outlived their launcher."""

import os
import sys
from typing import Annotated

import typer

from obk_cli.errors import EXIT_DONE, EXIT_FAILED
from obk_cli.process.shared_memory import remove_dead_segments
from obk_cli.runs.folder import runs_folder
from obk_cli.runs.orphans import end_leftovers, find_leftovers
from obk_cli.terminal import plain

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: obk reap --dry-run"


def command(
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only tell which processes would be ended.")
    ] = False,
) -> None:
    """End processes of stacks whose launcher is gone, with all that they started.

    Only processes of this user that an `obk launch` started, and no process of a stack that runs.
    Exit code 0: nothing is left; 1: something does not end.
    """
    found = find_leftovers(runs_folder(os.environ))
    for left in found:
        print(plain(f"{left.pid}  {left.run}  {left.command}"))
    if not found:
        print("nothing is left behind")
    if dry_run:
        raise typer.Exit(EXIT_DONE)
    there_still = end_leftovers(found)
    if found:
        remove_dead_segments()
    for left in there_still:
        print(f"error: process {left.pid} does not end", file=sys.stderr)
    raise typer.Exit(EXIT_FAILED if there_still else EXIT_DONE)
