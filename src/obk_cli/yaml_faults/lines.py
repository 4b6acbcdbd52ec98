"""Lines in which a blank or a colon is missing, or whose value holds a colon of its own."""

import re

from obk_cli.source import Span
from obk_cli.yaml_faults.characters import in_quotes
from obk_cli.yaml_faults.trouble import Cause, Trouble

__all__ = ["find_in_lines"]

_KEY = r"[A-Za-z_][A-Za-z0-9_.]*"
_ITEM = r"\s*(?:- +)*"
_GLUED_COLON = re.compile(rf"{_ITEM}({_KEY}):(?!//)([^\s:].*?)(?:\s+#.*)?$")
_GLUED_DASH = re.compile(rf"\s*(?:- +)*(-({_KEY}:(?:\s.*)?))$")
_KEY_ONLY = re.compile(rf"{_ITEM}({_KEY})\s*(?:#.*)?$")
_OTHER_COLON = re.compile(rf"{_ITEM}({_KEY})(?:\s*[=：]\s*|\s+)(\S.*?)(?:\s+#.*)?$")  # noqa: RUF001
_PAIR = re.compile(rf"{_ITEM}({_KEY}):\s+(\S.*?)(?:\s+#.*)?$")
_NEXT_PAIR = re.compile(rf",\s*{_KEY}:\s")
_IN_COLON_TROUBLE = ("mapping values are not allowed", "could not find expected ':'")


def find_in_lines(trouble: Trouble) -> Cause | None:
    """The mistake, if it is in one of the lines from the last value on."""
    first = trouble.before.scalar.line if trouble.before.scalar else trouble.line
    if trouble.context_place and "simple key" in trouble.context:
        first = min(first, trouble.context_place[0])
    for number in sorted({first, trouble.line - 1, trouble.line}):
        cause = _no_blank(trouble, number)
        if cause is not None:
            return cause
    if trouble.problem.startswith(_IN_COLON_TROUBLE[0]):
        return _two_colons(trouble)
    if trouble.problem.startswith(_IN_COLON_TROUBLE) and trouble.context_place:
        return _no_colon(trouble, trouble.context_place[0])
    return None


def _no_blank(trouble: Trouble, number: int) -> Cause | None:
    text = trouble.source.line(number)
    dash = _GLUED_DASH.match(text)
    if dash is not None:
        return Cause(
            message="a space is missing after the dash",
            span=Span.at(trouble.source, number, dash.start(1) + 1),
            help=f"write `- {dash[2]}`",
        )
    colon = _GLUED_COLON.match(text)
    if colon is not None:
        return Cause(
            message="a space is missing after the colon",
            span=Span.at(trouble.source, number, colon.end(1) + 1),
            help=f"write `{colon[1]}: {colon[2]}`",
        )
    return None


def _two_colons(trouble: Trouble) -> Cause | None:
    """`key: value: x`: the second colon makes a mapping of a value that started as text."""
    pair = _PAIR.match(trouble.text)
    if pair is None or trouble.column <= pair.end(1) + 1:
        return None
    value = pair[2]
    help = f"text with `: ` in it goes in quotes: `{pair[1]}: {in_quotes(value)}`"
    if _NEXT_PAIR.search(value):
        help = "every key has a line of its own; text with `: ` in it goes in quotes"
    return Cause(
        message=f"the value of `{pair[1]}` holds a colon with a space behind it",
        span=Span.at(trouble.source, trouble.line, pair.start(2) + 1, len(value)),
        help=help,
    )


def _no_colon(trouble: Trouble, number: int) -> Cause | None:
    text = trouble.source.line(number)
    key = _KEY_ONLY.match(text)
    if key is not None:
        return Cause(
            message=f"`{key[1]}` has no colon",
            span=Span.at(trouble.source, number, key.start(1) + 1, len(key[1])),
            help=f"write `{key[1]}:`",
        )
    pair = _OTHER_COLON.match(text)
    if pair is None:
        return None
    is_wide = text[pair.end(1) :].lstrip().startswith("：")  # noqa: RUF001
    return Cause(
        message=f"the colon of `{pair[1]}` is a wide one"
        if is_wide
        else f"`{pair[1]}` has no colon",
        span=Span.at(trouble.source, number, pair.start(1) + 1, len(pair[1])),
        help=f"write `{pair[1]}: {pair[2]}`",
    )
