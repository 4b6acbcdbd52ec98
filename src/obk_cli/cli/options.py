"""Option types and checks that several commands share; imports no library but typer."""

from collections.abc import Collection
from typing import Annotated, Final

import typer

from obelisk_spec.suggestions import ask_for, list_names, near_names
from obk_cli.errors import MisuseError

__all__ = ["FormatOption", "require_positive", "require_word", "wants_json"]

MOST: Final = 1e6
"""Of any number: seconds are 11 days, and beyond 24 the system's waits fail."""


def require_word(option: str, word: str, words: Collection[str]) -> None:
    """Refuse a word that is none of those that an option takes.

    Raises:
        MisuseError: it is not; the help asks for near ones.
    """
    if word not in words:
        raise MisuseError(
            f"`{option} {word}`: expected one of {list_names(words)}",
            help=ask_for(near_names(word, words)),
        )


def require_positive(option: str, number: float | None, what: str = "a number") -> None:
    """Refuse an option's number that is not above 0, or that is beyond all use.

    Args:
        option: as it is written.
        number: its value; None: it is not given.
        what: of what it is a number ("seconds").

    Raises:
        MisuseError: it is such a number.
    """
    if number is None or 0 < number <= MOST:
        return
    wanted = f"up to {MOST:.0f}" if number > MOST else "above 0"
    raise MisuseError(f"`{option} {number:g}`: expected {what} {wanted}")


FormatOption = Annotated[str, typer.Option(metavar="text|json", help="How to report.")]


def wants_json(format: str) -> bool:
    """Whether to print JSON.

    Raises:
        MisuseError: the format is none of the two.
    """
    if format not in ("text", "json"):
        raise MisuseError(f"`--format {format}`: expected `text` or `json`")
    return format == "json"
