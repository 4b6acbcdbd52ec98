"""The option of commands that print results for a person or for a program."""

from typing import Annotated

import typer

from obk_cli.errors import MisuseError

__all__ = ["FormatOption", "wants_json"]

FormatOption = Annotated[str, typer.Option(metavar="text|json", help="How to report.")]


def wants_json(format: str) -> bool:
    """Whether to print JSON.

    Raises:
        MisuseError: the format is none of the two.
    """
    if format not in ("text", "json"):
        raise MisuseError(f"`--format {format}`: expected `text` or `json`")
    return format == "json"
