"""Options of the commands that read a config, and the plan that they work with.

Importing this module does not load the compiler, so that `obk launch` can start the preload server
first.
"""

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from obk_cli.diagnostics.rules import RULES
from obk_cli.errors import EXIT_FAILED, MisuseError

if TYPE_CHECKING:
    from obk_cli.compiler import Options, Outcome
    from obk_cli.diagnostics.diagnostic import Diagnostic
    from obk_cli.plan.plan import Plan

__all__ = [
    "ColourOption",
    "ConfigArgument",
    "IgnoreOption",
    "SetOption",
    "make_options",
    "print_findings",
    "valid_plan",
    "wants_colour",
]

ConfigArgument = Annotated[str, typer.Argument(metavar="CONFIG", help="Config file; `-` is stdin.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Override a value, such as robot[0].pkg=mine; may be repeated.",
    ),
]
IgnoreOption = Annotated[
    list[str] | None,
    typer.Option("--ignore", metavar="CODE", help="Silence a rule or a family (OBK4)."),
]
ColourOption = Annotated[
    str, typer.Option("--color", metavar="auto|always|never", help="When to use color.")
]


def make_options(overrides: list[str] | None, ignore: list[str] | None) -> "Options":
    """The compiler's options from those of the command line and this process's environment.

    Raises:
        MisuseError: a code to ignore matches no rule.
    """
    codes = [code.strip().upper() for given in ignore or () for code in given.split(",")]
    for code in codes:
        if not any(rule.startswith(code) for rule in RULES) or not code:
            from obk_cli.config.suppressions import near_codes

            raise MisuseError(f"`--ignore {code}`: unknown rule", help=near_codes(code))

    from obk_cli.compiler import Options

    return Options(
        variables=dict(os.environ),
        working_folder=Path.cwd(),
        overrides=tuple(overrides or ()),
        ignore=tuple(codes),
    )


def wants_colour(choice: str, *, to_stderr: bool = False) -> bool:
    """Whether to use color. `auto`: on a capable terminal, unless NO_COLOR is set.

    Raises:
        MisuseError: the choice is none of the three.
    """
    if choice not in ("auto", "always", "never"):
        raise MisuseError(f"`--color {choice}`: expected `auto`, `always` or `never`")
    if choice != "auto":
        return choice == "always"
    stream = sys.stderr if to_stderr else sys.stdout
    is_dumb = os.environ.get("TERM") == "dumb"
    return stream.isatty() and not is_dumb and not os.environ.get("NO_COLOR")


def print_findings(findings: Sequence["Diagnostic"], color: str = "auto") -> None:
    """Print findings in full; `color` is the value of the option."""
    if findings:
        from obk_cli.report import report_text

        colour = wants_colour(color, to_stderr=True)
        print(report_text(findings, colour=colour, verbose=True), end="\n\n", file=sys.stderr)


def valid_plan(outcome: "Outcome", color: str, *, with_infos: bool = False) -> "Plan":
    """The plan of a config without errors; prints the findings and a summary.

    Args:
        outcome: the compiled config.
        color: the value of the option.
        with_infos: whether info-level findings are printed too.

    Raises:
        typer.Exit: the config has errors.
    """
    shown = tuple(d for d in outcome.diagnostics if with_infos or d.severity != "info")
    if shown:
        from obk_cli.report import report_text, summary

        colour = wants_colour(color, to_stderr=True)
        print(report_text(shown, colour=colour), end="\n\n", file=sys.stderr)
        print(summary((outcome.path,), shown, colour=colour), file=sys.stderr)
    if outcome.plan is None:
        raise typer.Exit(EXIT_FAILED)
    return outcome.plan
