"""`obk logs [RUN] [NODE] [-f]`: show the log of a run or of one of its nodes."""

import os
import sys
from collections import deque
from collections.abc import Iterable
from typing import Annotated

import typer

from obk_cli.cli.complete import complete_kept_runs
from obk_cli.cli.config_options import ColourOption, wants_colour
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.files import explain_os_error
from obk_cli.process.signals import until_interrupt
from obk_cli.runs.folder import runs_folder
from obk_cli.runs.logs import find_log, follow_lines, read_lines
from obk_cli.terminal import only_colour, plain

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: obk logs dummy control_0 -f"


def command(
    run: Annotated[
        str | None,
        typer.Argument(
            metavar="[RUN]",
            help="Run, by the name of its config or folder. Default: the latest.",
            autocompletion=complete_kept_runs,
        ),
    ] = None,
    node: Annotated[
        str | None,
        typer.Argument(metavar="[NODE]", help="Node name. Default: the launcher's own log."),
    ] = None,
    follow: Annotated[
        bool,
        typer.Option("--follow", "-f", help="Show new lines as they are written, until Ctrl-C."),
    ] = False,
    lines: Annotated[
        int | None, typer.Option("--lines", "-n", help="Show only this many lines from the end.")
    ] = None,
    color: ColourOption = "auto",
) -> None:
    """Show the log of a run, or of one of its nodes.

    RUN is the name of a config (its latest run; `NAME~1`: the one before) or of a run's folder.
    NODE is a name, full or short (control_0). `obk logs control_0` shows that node in the latest
    run.
    """
    if lines is not None and lines < 0:
        raise MisuseError("`--lines`: expected a number of at least 0")
    path = find_log(runs_folder(os.environ), run, node)
    is_colour = wants_colour(color)
    try:
        if not follow:
            if not path.exists():
                print(f"{path} does not exist: the node logged nothing", file=sys.stderr)
            _show(_last(read_lines(path), lines), colour=is_colour)
            return
        with until_interrupt():
            _follow(path_lines=iter(follow_lines(path)), last=lines, colour=is_colour)
    except PermissionError as error:
        raise CommandFailedError(f"{path}: {explain_os_error(error)}") from error


def _follow(path_lines: Iterable[str | None], last: int | None, *, colour: bool) -> None:
    """Print the existing lines, then new ones as they are written."""
    backlog: deque[str] | None = deque(maxlen=last)
    for line in path_lines:
        if backlog is not None:
            if line is not None:
                backlog.append(line)
                continue
            _show(backlog, colour=colour)
            backlog = None
        elif line is not None:
            _show((line,), colour=colour)


def _last(lines: Iterable[str], count: int | None) -> Iterable[str]:
    return lines if count is None else deque(lines, maxlen=count)


def _show(lines: Iterable[str], *, colour: bool) -> None:
    for line in lines:
        print(only_colour(line) if colour else plain(line))
    sys.stdout.flush()
