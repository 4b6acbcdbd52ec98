"""Options that every command with a config takes, and what they come to."""

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from obk_cli.compiler import Options
from obk_cli.config.suppressions import near_codes
from obk_cli.diagnostics.rules import RULES
from obk_cli.errors import MisuseError

__all__ = [
    "ColourOption",
    "ConfigArgument",
    "IgnoreOption",
    "SetOption",
    "make_options",
    "wants_colour",
]

ConfigArgument = Annotated[str, typer.Argument(metavar="CONFIG", help="The config; `-` is stdin.")]
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
    str, typer.Option("--color", metavar="auto|always|never", help="When to use colour.")
]


def make_options(overrides: list[str] | None, ignore: list[str] | None) -> Options:
    """The compiler's options from those of the command line and this process's environment.

    Raises:
        MisuseError: a code to ignore is the beginning of none.
    """
    codes = [code.strip().upper() for given in ignore or () for code in given.split(",")]
    for code in codes:
        if not any(rule.startswith(code) for rule in RULES) or not code:
            raise MisuseError(f"`--ignore {code}` names no rule", help=near_codes(code))
    return Options(
        variables=dict(os.environ),
        working_folder=Path.cwd(),
        overrides=tuple(overrides or ()),
        ignore=tuple(codes),
    )


def wants_colour(choice: str, *, to_stderr: bool = False) -> bool:
    """Whether to colour: as asked, else on a terminal that can, unless NO_COLOR is set.

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
