"""Names that exist and look like one that does not, for "did you mean"."""

import re
from collections.abc import Iterable
from difflib import get_close_matches

__all__ = [
    "ask_for",
    "comparable",
    "did_you_mean",
    "list_names",
    "near_names",
    "sure_name",
    "there_is",
]

_PART = re.compile(r"[_/.\s-]+")
_DIGITS = re.compile(r"[0-9]+")

_MOST_COMPARED = 200
_MOST_SIFTED = 2_000
_LONGEST = 100


def near_names(name: str, known: Iterable[str], *, most: int = 3) -> tuple[str, ...]:
    """The known names closest to `name`, best first; letter case does not count."""
    by_folded = {candidate.casefold(): candidate for candidate in comparable(name, known)}
    close = get_close_matches(name.casefold(), by_folded, n=most, cutoff=0.6)
    return tuple(by_folded[folded] for folded in close)


def comparable(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """The known names worth the time to compare `name` with; none where that would be too many.

    Among many, those of about the same length that begin and end alike.
    """
    every = tuple(known)
    if len(name) > _LONGEST or len(every) > _MOST_SIFTED:
        return ()
    if len(every) > _MOST_COMPARED:
        begin, end = name[:1].casefold(), name[-1:].casefold()
        every = tuple(
            other
            for other in every
            if abs(len(other) - len(name)) <= 2
            and other[:1].casefold() == begin
            and other[-1:].casefold() == end
        )
    if len(every) > _MOST_COMPARED:
        return ()
    return tuple(other for other in every if len(other) <= _LONGEST)


def list_names(names: Iterable[str], *, most: int = 8) -> str:
    """Names in quotes for a message, the rest counted: "`a`, `b` and 3 more"."""
    every = list(names)
    shown = ", ".join(f"`{name}`" for name in every[:most])
    return shown if len(every) <= most else f"{shown} and {len(every) - most} more"


def did_you_mean(name: str, known: Iterable[str]) -> str | None:
    """A help line: the near names, or what exists at all; None where nothing exists."""
    every = list(known)
    return ask_for(near_names(name, every)) or there_is(every)


def there_is(known: Iterable[str]) -> str | None:
    """A help line that names what exists; None where nothing does."""
    every = list(known)
    return f"there is: {list_names(every)}" if every else None


def ask_for(meant: Iterable[str]) -> str | None:
    """A help line: "did you mean `a` or `b`?"; None without any name."""
    names = " or ".join(f"`{name}`" for name in meant)
    return f"did you mean {names}?" if names else None


def sure_name(name: str, known: Iterable[str]) -> str | None:
    """The one known name that `name` is a slip of the pen from, None where there is any doubt.

    One or two letters may be wrong, never a number or a whole part: `l_knee` is not `r_knee`.
    """
    folded = name.casefold()
    slips = {other for other in comparable(name, known) if _is_slip(folded, other.casefold())}
    return slips.pop() if len(slips) == 1 else None


def _is_slip(name: str, candidate: str) -> bool:
    if _DIGITS.findall(name) != _DIGITS.findall(candidate):
        return False
    parts, meant = _PART.split(name), _PART.split(candidate)
    if len(parts) != len(meant):
        parts, meant = [name], [candidate]
    distances = [_distance(*pair) for pair in zip(parts, meant, strict=True)]
    allowed = [_allowed(max(map(len, pair))) for pair in zip(parts, meant, strict=True)]
    is_small = all(d <= most for d, most in zip(distances, allowed, strict=True))
    return is_small and sum(distances) <= _allowed(max(len(name), len(candidate)))


def _allowed(length: int) -> int:
    """How many letters of a part may be wrong: none of `l` or `fr`, which stand for themselves."""
    return 0 if length < 3 else 1 if length < 6 else 2


def _distance(one: str, other: str) -> int:
    """Letters to put in, take out, replace or swap with their neighbour; 3 stands for more."""
    if abs(len(one) - len(other)) > 2:
        return 3
    before: list[int] = []
    row = list(range(len(other) + 1))
    for i, letter in enumerate(one, 1):
        last, before, row = before, row, [i]
        for j, wanted in enumerate(other, 1):
            cost = min(before[j] + 1, row[-1] + 1, before[j - 1] + (letter != wanted))
            if i > 1 and j > 1 and letter == other[j - 2] and one[i - 2] == wanted:
                cost = min(cost, last[j - 2] + 1)
            row.append(cost)
        if min(*row, *before) > 2:
            return 3
    return row[-1]
