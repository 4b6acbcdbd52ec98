"""`obk doctor`: run the checks on this machine and print what to fix."""

import json
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Final

import typer

from obelisk_spec.suggestions import did_you_mean, with_number
from obk_cli.cli.config_options import ColourOption, wants_colour
from obk_cli.cli.options import FormatOption, print_json, wants_json
from obk_cli.doctor.checks import Answer, Check, checks_of, examine
from obk_cli.doctor.finding import SEVERITIES, Finding, Severity
from obk_cli.errors import EXIT_DONE, EXIT_FAILED, MisuseError

__all__ = ["doctor_json", "doctor_text"]

_COLOURS: Final[dict[str, str]] = {"ok": "32", "note": "36", "warning": "33", "error": "31"}
_WIDTH: Final = max(map(len, SEVERITIES))


def doctor_text(answers: Sequence[Answer], *, colour: bool) -> str:
    """A line for each finding with its fix below, and a summary."""
    width = max((len(answer.check) for answer in answers), default=0)
    lines: list[str] = []
    for answer in answers:
        for place, finding in enumerate(answer.findings):
            name = answer.check if place == 0 else ""
            lines += _lines(f"{name:<{width}}", finding, colour)
    return "\n".join((*lines, "", _summary(answers, colour)))


def doctor_json(answers: Sequence[Answer]) -> str:
    """All findings with their measured values."""
    findings = [
        {"check": answer.check, **asdict(finding)}
        for answer in answers
        for finding in answer.findings
    ]
    seconds = {answer.check: round(answer.seconds, 3) for answer in answers}
    counts = _counts(answers)
    report = {
        "findings": findings,
        "counts": {s: counts[s] for s in SEVERITIES},
        "seconds": seconds,
    }
    return json.dumps(report, indent=1)


def _lines(name: str, finding: Finding, colour: bool) -> Iterator[str]:
    label = _coloured(finding.severity, f"{finding.severity:<{_WIDTH}}", colour)
    indent = " " * (len(name) + _WIDTH + 4)
    first, *rest = finding.message.splitlines()
    yield f"{name}  {label}  {first}"
    yield from (f"{indent}{line}" for line in rest)
    if finding.fix:
        yield f"{indent}fix: {finding.fix}"


def _summary(answers: Sequence[Answer], colour: bool) -> str:
    counts = _counts(answers)
    parts = [
        _coloured(severity, with_number(counts[severity], severity), colour)
        for severity in SEVERITIES
        if severity != "ok" and counts[severity]
    ]
    checks = with_number(len(answers), "check")
    return f"{checks}: {', '.join(parts) if parts else _coloured('ok', 'no problems', colour)}"


def _counts(answers: Sequence[Answer]) -> Counter[Severity]:
    return Counter(finding.severity for answer in answers for finding in answer.findings)


def _coloured(severity: Severity, text: str, colour: bool) -> str:
    return f"\x1b[{_COLOURS[severity]}m{text}\x1b[0m" if colour else text


EXAMPLE = """\b
Example: obk doctor
         obk doctor discovery mujoco
         obk doctor --format json > doctor.json
"""

TIMEOUT_S: Final = 30.0
"""Limit for one check; its child processes have shorter limits [s]."""


def command(
    checks: Annotated[
        list[str] | None, typer.Argument(metavar="[CHECK...]", help="Checks to run. Default: all.")
    ] = None,
    list_: Annotated[
        bool, typer.Option("--list", help="List the checks without running them.")
    ] = False,
    format: FormatOption = "text",
    color: ColourOption = "auto",
) -> None:
    """Check whether this machine can run stacks; report problems and how to fix them.

    The command changes nothing; it tests the network, compilers and graphics in separate processes.
    Exit code 0: no errors (there may be warnings); 1: errors; 2: usage error.
    """
    is_json, colour = wants_json(format), wants_colour(color)
    every = checks_of(os.environ, Path.cwd())
    chosen = _chosen(checks or [], every)
    if list_ and is_json:
        print_json([{"name": check.name, "about": check.about} for check in chosen])
        raise typer.Exit(EXIT_DONE)
    if list_:
        width = max(len(check.name) for check in every)
        for check in chosen:
            print(f"{check.name:<{width}}  {check.about}")
        raise typer.Exit(EXIT_DONE)
    answers = _examined(chosen)
    print(doctor_json(answers) if is_json else doctor_text(answers, colour=colour))
    failed = any(found.severity == "error" for answer in answers for found in answer.findings)
    raise typer.Exit(EXIT_FAILED if failed else EXIT_DONE)


def _chosen(names: Sequence[str], every: Sequence[Check]) -> tuple[Check, ...]:
    known = [check.name for check in every]
    for name in names:
        if name not in known:
            raise MisuseError(
                f"unknown check `{name}`",
                help=did_you_mean(name, known) or "list them with `obk doctor --list`",
            )
    return tuple(check for check in every if not names or check.name in names)


def _examined(checks: Sequence[Check]) -> tuple[Answer, ...]:
    if not sys.stderr.isatty():
        return examine(checks, timeout_s=TIMEOUT_S)
    from rich.console import Console  # slow to import
    from rich.status import Status

    with Status("", console=Console(stderr=True)) as status:
        return examine(
            checks, timeout_s=TIMEOUT_S, on_pending=_shown_on(status.update, len(checks))
        )


def _shown_on(update: Callable[[str], None], count: int) -> Callable[[tuple[str, ...]], None]:
    def show(pending: tuple[str, ...]) -> None:
        update(f"{count - len(pending)} of {count} checks; running: {', '.join(pending)}")

    return show
