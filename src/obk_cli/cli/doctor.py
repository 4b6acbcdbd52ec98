"""`obk doctor`: what is installed, what is missing, what to do about it."""

import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Final

import typer

from obelisk_spec.suggestions import did_you_mean
from obk_cli.cli.config_options import ColourOption, wants_colour
from obk_cli.cli.text_or_json import FormatOption, wants_json
from obk_cli.doctor.checks import checks_of
from obk_cli.doctor.examination import Answer, Check, examine
from obk_cli.errors import EXIT_DONE, EXIT_FAILED, MisuseError
from obk_cli.report.doctor import doctor_json, doctor_text

__all__ = ["EXAMPLE", "command"]

EXAMPLE = """\b
Example: obk doctor
         obk doctor discovery mujoco
         obk doctor --format json > doctor.json
"""

TIMEOUT_S: Final = 30.0
"""Of one check; what it tries in processes of their own ends sooner [s]."""


def command(
    checks: Annotated[
        list[str] | None, typer.Argument(metavar="[CHECK...]", help="Which checks; none: all.")
    ] = None,
    list_: Annotated[
        bool, typer.Option("--list", help="Only tell which checks there are.")
    ] = False,
    format: FormatOption = "text",
    color: ColourOption = "auto",
) -> None:
    """Look at this machine as stacks need it; say what is wrong and what to do about it.

    Networks, compilers and graphics are really tried, in processes of their own. Changes nothing.
    Exit code 0: no errors (there may be warnings); 1: errors; 2: misuse.
    """
    is_json, colour = wants_json(format), wants_colour(color)
    every = checks_of(os.environ, Path.cwd())
    chosen = _chosen(checks or [], every)
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
                f"there is no check `{name}`",
                help=did_you_mean(name, known) or "`obk doctor --list` shows them",
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
        update(f"{count - len(pending)} of {count} checks; still at it: {', '.join(pending)}")

    return show
