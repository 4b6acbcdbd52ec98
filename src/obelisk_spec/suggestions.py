"""Suggest existing names for an unknown one ("did you mean"), and format names for messages."""

import re
from collections import Counter
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
    "with_article",
    "with_number",
]

_PART = re.compile(r"[_/.\s-]+")
_DIGITS = re.compile(r"[0-9]+")

_MOST_COMPARED = 200
_MOST_SIFTED = 2_000
_LONGEST = 100


def near_names(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """Return up to three known names, those closest to `name`, best first, ignoring case."""
    by_folded = {candidate.casefold(): candidate for candidate in comparable(name, known)}
    close = get_close_matches(name.casefold(), by_folded, n=3, cutoff=0.6)
    return tuple(by_folded[folded] for folded in close)


def comparable(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """Return the known names that are worth comparing with `name`; none if there are too many.

    If there are many, these are only names of similar length with the same first and last letter.
    """
    every = tuple(known)
    if len(name) > _LONGEST or len(every) > _MOST_SIFTED:
        return ()
    if len(every) > _MOST_COMPARED:
        first, last = name[:1].casefold(), name[-1:].casefold()
        every = tuple(
            other
            for other in every
            if abs(len(other) - len(name)) <= 2
            and other[:1].casefold() == first
            and other[-1:].casefold() == last
        )
    if len(every) > _MOST_COMPARED:
        return ()
    return tuple(other for other in every if len(other) <= _LONGEST)


def list_names(names: Iterable[str], *, most: int = 8) -> str:
    """Quote names for a message, and count the rest: "`a`, `b` and 3 more"."""
    every = list(names)
    shown = ", ".join(f"`{name}`" for name in every[:most])
    return shown if len(every) <= most else f"{shown} and {len(every) - most} more"


def with_article(name: str) -> str:
    """Quote a name with its article: "a `hinge`", "an `ObkImu`".

    A leading u (`user`, `uint8`, `UInt16`) is pronounced as a consonant.
    """
    return f"{'an' if name[:1].lower() in ('a', 'e', 'i', 'o') else 'a'} `{name}`"


def with_number(count: int, noun: str) -> str:
    """Format a number with its noun, in the plural unless it is 1: "1 node", "2 nodes"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def did_you_mean(name: str, known: Iterable[str]) -> str | None:
    """Build a help line with similar names, otherwise with all names; None if none exist."""
    every = list(known)
    return ask_for(near_names(name, every)) or there_is(every)


def there_is(known: Iterable[str]) -> str | None:
    """Build a help line that lists the existing names; None if none exist."""
    every = list(known)
    return f"available: {list_names(every)}" if every else None


def ask_for(meant: Iterable[str]) -> str | None:
    """Build the help line "did you mean `a` or `b`?"; None without names."""
    names = [f"`{name}`" for name in meant]
    if not names:
        return None
    return f"did you mean {', '.join(names[:-1])}{' or ' if names[:-1] else ''}{names[-1]}?"


def sure_name(name: str, known: Iterable[str]) -> str | None:
    """Return the only known name that `name` can be a typo of; None if ambiguous.

    One or two letters may be missing, superfluous or swapped, but none replaced by another one, and
    never a number or a whole part: `/larm/ctrl` is not `/rarm/ctrl`, and `l_knee` not `r_knee`.
    """
    folded = name.casefold()
    slips = {other for other in comparable(name, known) if _is_slip(folded, other.casefold())}
    return slips.pop() if len(slips) == 1 else None


def _is_slip(name: str, candidate: str) -> bool:
    if _DIGITS.findall(name) != _DIGITS.findall(candidate):
        return False
    letters, meant_letters = Counter(name), Counter(candidate)
    if letters - meant_letters and meant_letters - letters:  # a letter is replaced
        return False
    parts, meant = _PART.split(name), _PART.split(candidate)
    if len(parts) != len(meant):
        parts, meant = [name], [candidate]
    distances = [_distance(*pair) for pair in zip(parts, meant, strict=True)]
    allowed = [_allowed(max(map(len, pair))) for pair in zip(parts, meant, strict=True)]
    is_small = all(d <= most for d, most in zip(distances, allowed, strict=True))
    return is_small and sum(distances) <= _allowed(max(len(name), len(candidate)))


def _allowed(length: int) -> int:
    """Return the number of letters of a part that may be wrong: none in `l` or `fr`."""
    return 0 if length < 3 else 1 if length < 6 else 2


def _distance(one: str, other: str) -> int:
    """Edit distance with transpositions, at most 3."""
    if abs(len(one) - len(other)) > 2:
        return 3
    before: list[int] = []
    row = list(range(len(other) + 1))
    for i, letter in enumerate(one, 1):
        last, before, row = before, row, [i]
        for j, expected in enumerate(other, 1):
            cost = min(before[j] + 1, row[-1] + 1, before[j - 1] + (letter != expected))
            if i > 1 and j > 1 and letter == other[j - 2] and one[i - 2] == expected:
                cost = min(cost, last[j - 2] + 1)
            row.append(cost)
        if min(*row, *before) > 2:
            return 3
    return row[-1]
