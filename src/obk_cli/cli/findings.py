"""The findings of a config on stderr, and the end of a command that needs one without errors."""

import sys
from collections.abc import Sequence

import typer

from obk_cli.cli.config_options import wants_colour
from obk_cli.compiler import Outcome
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.errors import EXIT_FAILED
from obk_cli.plan.plan import Plan
from obk_cli.report.text import report_text, summary

__all__ = ["print_findings", "sound_plan"]


def print_findings(findings: Sequence[Diagnostic], color: str = "auto") -> None:
    """Print findings in full; `color` is the word of the option."""
    if findings:
        colour = wants_colour(color, to_stderr=True)
        print(report_text(findings, colour=colour, verbose=True), end="\n\n", file=sys.stderr)


def sound_plan(outcome: Outcome, color: str, *, with_infos: bool = False) -> Plan:
    """The plan of a config without errors; its findings are printed with their sum.

    Args:
        outcome: what became of the config.
        color: the word of the option.
        with_infos: whether infos are printed too.

    Raises:
        typer.Exit: the config has errors.
    """
    shown = tuple(d for d in outcome.diagnostics if with_infos or d.severity != "info")
    if shown:
        colour = wants_colour(color, to_stderr=True)
        print(report_text(shown, colour=colour), end="\n\n", file=sys.stderr)
        print(summary((outcome.path,), shown, colour=colour), file=sys.stderr)
    if outcome.plan is None:
        raise typer.Exit(EXIT_FAILED)
    return outcome.plan
