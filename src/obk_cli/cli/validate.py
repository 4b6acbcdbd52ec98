"""`obk validate CONFIG...`: every check, nothing started."""

from typing import Annotated

import typer

from obelisk_spec.near import list_names
from obk_cli.cli.config_options import (
    ColourOption,
    IgnoreOption,
    SetOption,
    make_options,
    wants_colour,
)
from obk_cli.diagnostics import Diagnostic, in_order
from obk_cli.errors import EXIT_DONE, EXIT_FAILED, MisuseError
from obk_cli.pipeline import compile_config
from obk_cli.report.github import report_github
from obk_cli.report.json import report_json
from obk_cli.report.sarif import report_sarif
from obk_cli.report.text import report_text, summary

__all__ = ["EXAMPLE", "command"]

_FORMATS = ("text", "json", "sarif", "github")

EXAMPLE = "Example: obk validate config.yaml --ignore OBK4"


def command(
    configs: Annotated[
        list[str], typer.Argument(metavar="CONFIG...", help="Configs; `-` is stdin.")
    ],
    format: Annotated[
        str, typer.Option(metavar="text|json|sarif|github", help="How to report.")
    ] = "text",
    strict: Annotated[bool, typer.Option("--strict", help="Fail on warnings too.")] = False,
    ignore: IgnoreOption = None,
    set_: SetOption = None,
    color: ColourOption = "auto",
) -> None:
    """Check configs: the text, the wiring, the model, the packages. Starts nothing.

    Exit code 0: no errors; 1: errors, with --strict warnings too; 2: misuse.
    """
    if format not in _FORMATS:
        raise MisuseError(f"`--format {format}`: expected one of {list_names(_FORMATS)}")
    options = make_options(set_, ignore)
    outcomes = [compile_config(config, options) for config in configs]
    findings = in_order(finding for outcome in outcomes for finding in outcome.diagnostics)
    paths = [outcome.path for outcome in outcomes]
    _print_report(format, paths, findings, colour=wants_colour(color))
    failing = ("error", "warning") if strict else ("error",)
    failed = any(finding.severity in failing for finding in findings)
    raise typer.Exit(EXIT_FAILED if failed else EXIT_DONE)


def _print_report(
    form: str, paths: list[str], findings: tuple[Diagnostic, ...], *, colour: bool
) -> None:
    match form:
        case "json":
            print(report_json(paths, findings))
        case "sarif":
            print(report_sarif(findings))
        case "github":
            print(report_github(findings), end="\n" if findings else "")
        case _:
            if findings:
                print(report_text(findings, colour=colour), end="\n\n")
            print(summary(paths, findings, colour=colour))
