"""`obk launch CONFIG`: validates, starts, configures, activates, watches, ends in order."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, cast, get_args

import typer

from obk_cli.cli.config_options import (
    ColourOption,
    ConfigArgument,
    IgnoreOption,
    SetOption,
    make_options,
    wants_colour,
)
from obk_cli.config import Stack
from obk_cli.errors import EXIT_FAILED, MisuseError
from obk_cli.launch.order import UNTIL
from obk_cli.pipeline import Outcome, compile_config
from obk_cli.report.text import report_text, summary

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: obk launch examples/dummy/dummy.yaml --duration 20"


def command(
    config: ConfigArgument,
    until: Annotated[
        str, typer.Option(metavar="|".join(UNTIL), help="How far the bring-up goes.")
    ] = "active",
    duration: Annotated[
        float | None, typer.Option(help="Seconds after which the stack is brought down.")
    ] = None,
    timeout: Annotated[float, typer.Option(help="Seconds that a transition may take.")] = 10.0,
    network: Annotated[
        str | None,
        typer.Option(metavar="localhost|lan", help="Who can discover the stack."),
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Leave the nodes' output out.")] = False,
    set_: SetOption = None,
    ignore: IgnoreOption = None,
    color: ColourOption = "auto",
) -> None:
    """Start a stack, bring it up in order, watch it, and bring it down in order.

    Ends on Ctrl-C, on SIGTERM, after --duration, or when a node fails. No process of the stack
    outlives this one. Exit code 0: ended in order; 1: the config has errors, or a node failed.
    """
    if until not in UNTIL:
        raise MisuseError(f"`--until {until}`: expected one of {', '.join(UNTIL)}")
    if timeout <= 0 or (duration is not None and duration < 0):
        raise MisuseError("`--timeout` is seconds above 0, `--duration` seconds of at least 0")
    outcome = compile_config(config, make_options(set_, ignore))
    _show_findings(outcome, colour=wants_colour(color, to_stderr=True))
    if outcome.plan is None:
        raise typer.Exit(EXIT_FAILED)

    from obk_cli.adapters.packages import PackageIndex
    from obk_cli.adapters.ros_environment import Network, ros_environment
    from obk_cli.adapters.screen import Screen
    from obk_cli.launch.supervisor import Limits
    from obk_cli.report.launch import LaunchReport
    from obk_cli.running import LaunchOptions, run_plan

    if network is not None and network not in get_args(Network):
        raise MisuseError(f"`--network {network}`: expected one of {', '.join(get_args(Network))}")
    environment = ros_environment(cast(Network | None, network))
    for note in (*environment.notes, *(_unsupported(outcome.config) if outcome.config else ())):
        print(f"warning: {note}", file=sys.stderr)
    working_folder = Path.cwd()
    folder = (working_folder / config).resolve().parent
    plan = outcome.plan
    names = (p.full_name for p in plan.processes)
    with Screen(sys.stdout.fileno()) as screen:
        ended = run_plan(
            plan,
            PackageIndex.around(folder, working_folder, environment.variables),
            environment,
            LaunchOptions(
                config=config,
                folder=working_folder,
                until=until,
                duration_s=duration,
                limits=Limits(transition_s=timeout),
            ),
            screen=screen,
            voice=LaunchReport(names, colour=wants_colour(color), quiet=quiet),
        )
    raise typer.Exit(ended.exit_code)


def _unsupported(stack: Stack) -> Iterator[str]:
    """What the config asks for and the launcher does not do yet, in sentences."""
    for node in stack.nodes:
        if node.on_crash is not None and node.on_crash.value != "stop":
            yield (
                f"{node.on_crash.span}: not supported yet: `on_crash: {node.on_crash.value}`; "
                f"the whole stack is stopped when {node.node_name} crashes"
            )
        if node.respawn is not None and node.respawn.value:
            yield (
                f"{node.respawn.span}: not supported yet: `respawn: true`; "
                f"the whole stack is stopped when {node.node_name} ends"
            )
    devices = list(dict.fromkeys(node.device for node in stack.nodes))
    if len(devices) > 1:
        yield f"not supported yet: several devices; the nodes of {', '.join(devices)} all run here"


def _show_findings(outcome: Outcome, *, colour: bool) -> None:
    shown = tuple(d for d in outcome.diagnostics if d.severity != "info")
    if shown:
        print(report_text(shown, colour=colour), end="\n\n", file=sys.stderr)
        print(summary((outcome.path,), shown, colour=colour), file=sys.stderr)
