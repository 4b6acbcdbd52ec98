"""`obk monitor`: a live view of a running stack, in the terminal or as JSON."""

import os
import shutil
import sys
from typing import Annotated, Final

import typer

from obk_cli.cli.options import (
    TIMEOUT_S,
    DomainOption,
    FormatOption,
    graph_target,
    require_positive,
    wants_json,
    with_types,
)
from obk_cli.errors import EXIT_DONE, MisuseError
from obk_cli.introspect.message_text import json_line
from obk_cli.monitor.model import StackView
from obk_cli.monitor.parameters import StackParameters
from obk_cli.monitor.stack_follower import StackFollower, StackSelector
from obk_cli.monitor.table import monitor_data, monitor_text
from obk_cli.optional_deps import require_extra
from obk_cli.runs.folder import runs_folder

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: obk monitor --once --format json"
WIDE: Final = 200
"""Columns without a terminal."""


def command(
    once: Annotated[bool, typer.Option("--once", help="Print one snapshot and exit.")] = False,
    period: Annotated[
        float, typer.Option(metavar="SECONDS", help="Refresh interval in seconds.")
    ] = 1.0,
    run: Annotated[
        str | None,
        typer.Option(metavar="RUN", help="Stack, by the name of its config or run folder."),
    ] = None,
    domain: DomainOption = None,
    format: FormatOption = "text",
) -> None:
    """Show a running stack live: nodes, topics with their rates, latest log lines.

    Rates are measured on the serialized messages. `!` marks topics that are more than 10 % off the
    rate that the config expects. Keys trigger transitions of the stack or of one node, and `p`
    tunes parameters; `?` lists all keys. If no stack is running, the command waits for one.
    --format json prints one JSON object per period, on a line of its own, until the stack stops.
    For a stack on another host, expected rates, parameters and log are not available.
    """
    is_json = wants_json(format)
    require_positive("--period", period, "a number of seconds")
    target = StackSelector(
        environment=graph_target(domain, TIMEOUT_S).environment, domain=domain, run=run
    )
    follower = StackFollower(target, with_types, period)
    if once or is_json:
        _print_views(follower, target, is_json=is_json, is_once=once)
        return
    # textual draws on the error output.
    if not all(stream.isatty() for stream in (sys.stdin, sys.stdout, sys.stderr)):
        raise MisuseError(
            "`obk monitor` needs a terminal for input and output",
            help="without a terminal, use `obk monitor --once` or `obk monitor --format json`",
        )
    require_extra("textual", "monitor")
    from obk_cli.monitor.app import run_monitor

    run_monitor(follower, target.change, StackParameters(runs_folder(os.environ)))


def _print_views(
    follower: StackFollower, target: StackSelector, *, is_json: bool, is_once: bool
) -> None:
    for view in follower.views():
        if view is None:
            raise target.no_nodes_error()
        print(json_line(monitor_data(view)) if is_json else _text(view), flush=True)
        if is_once or view.has_ended:
            raise typer.Exit(EXIT_DONE)


def _text(view: StackView) -> str:
    is_terminal = sys.stdout.isatty()
    width = shutil.get_terminal_size().columns if is_terminal else WIDE
    return monitor_text(view, width, colour=is_terminal and not os.environ.get("NO_COLOR"))
