"""Names that exist and look like one that does not, for "did you mean"."""

from collections.abc import Iterable
from difflib import get_close_matches

__all__ = ["did_you_mean", "list_names", "near_names"]


def near_names(name: str, known: Iterable[str], *, most: int = 3) -> tuple[str, ...]:
    """The known names closest to `name`, best first; letter case does not count."""
    by_folded = {candidate.casefold(): candidate for candidate in known}
    close = get_close_matches(name.casefold(), by_folded, n=most, cutoff=0.6)
    return tuple(by_folded[folded] for folded in close)


def list_names(names: Iterable[str], *, most: int = 8) -> str:
    """Names in quotes for a message, the rest counted: "`a`, `b` and 3 more"."""
    every = list(names)
    shown = ", ".join(f"`{name}`" for name in every[:most])
    return shown if len(every) <= most else f"{shown} and {len(every) - most} more"


def did_you_mean(name: str, known: Iterable[str]) -> str | None:
    """A help line: the near names, or what exists at all; None where nothing exists."""
    every = list(known)
    close = near_names(name, every)
    if close:
        return f"did you mean {' or '.join(f'`{candidate}`' for candidate in close)}?"
    return f"there is: {list_names(every)}" if every else None
