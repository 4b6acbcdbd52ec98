"""`obk compile CONFIG`: the plan, or the parameter files that the nodes are started with."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from obk_cli.adapters.files import explain_os_error
from obk_cli.cli.config_options import (
    ColourOption,
    ConfigArgument,
    IgnoreOption,
    SetOption,
    make_options,
    wants_colour,
)
from obk_cli.emit.params import emit_params, params_file_name
from obk_cli.emit.plan_json import emit_plan
from obk_cli.emit.write import write_text
from obk_cli.errors import EXIT_FAILED, CommandFailedError, MisuseError
from obk_cli.pipeline import compile_config
from obk_cli.plan import Plan
from obk_cli.report.text import report_text, summary

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: obk compile config.yaml --to params --output build/params"


def command(
    config: ConfigArgument,
    to: Annotated[str, typer.Option(metavar="params|plan", help="What to make.")] = "plan",
    output: Annotated[
        Path | None,
        typer.Option(help="File to write, for params a folder with a file for each node."),
    ] = None,
    ignore: IgnoreOption = None,
    set_: SetOption = None,
    color: ColourOption = "auto",
) -> None:
    """Turn a valid config into what others read. Findings go to stderr."""
    if to not in ("params", "plan"):
        raise MisuseError(f"`--to {to}`: expected `params` or `plan`")
    outcome = compile_config(config, make_options(set_, ignore))
    if outcome.diagnostics:
        colour = wants_colour(color, to_stderr=True)
        print(report_text(outcome.diagnostics, colour=colour), end="\n\n", file=sys.stderr)
        print(summary([outcome.path], outcome.diagnostics, colour=colour), file=sys.stderr)
    if outcome.plan is None:
        raise typer.Exit(EXIT_FAILED)
    _deliver(outcome.plan, to, output)


def _deliver(plan: Plan, to: str, output: Path | None) -> None:
    if output is None:
        print(emit_plan(plan) if to == "plan" else emit_params(plan.processes), end="")
        return
    texts = {output: emit_plan(plan)}
    if to == "params":
        texts = {output / params_file_name(p): emit_params((p,)) for p in plan.processes}
    for path, text in texts.items():
        try:
            write_text(path, text)
        except OSError as error:
            reason = explain_os_error(error)
            raise CommandFailedError(f"`{path}` cannot be written: {reason}") from error
