"""Brackets and braces that are left open, closed twice, or lack a comma."""

import re

from obk_cli.diagnostics import Related
from obk_cli.source import Span
from obk_cli.yaml_faults.trouble import Cause, Trouble, indent_of, without_comment

__all__ = ["find_in_brackets"]

_CLOSING = {"[": "]", "{": "}"}
_LAST_WORD = re.compile(r"\S+\s*$")


def find_in_brackets(trouble: Trouble) -> Cause | None:
    """The mistake, if it is one with brackets."""
    opened = trouble.before.bracket
    if opened is None:
        return _closed_too_often(trouble)
    opening = trouble.source.line(opened.line)
    is_below = trouble.line > opened.line
    if is_below and (trouble.is_at_end or indent_of(trouble.text) <= indent_of(opening)):
        return _never_closed(opened, trouble)
    if not trouble.rest:
        return None if is_below else _never_closed(opened, trouble)
    if trouble.rest[:1] in ("]", "}"):
        return _other_closing(opened, trouble)
    return _no_comma(opened, trouble)


def _never_closed(opened: Span, trouble: Trouble) -> Cause:
    opening = opened.source.line(opened.line)
    bracket = opening[opened.column - 1]
    written = without_comment(opening[opened.column - 1 :])
    is_near = trouble.is_at_end or trouble.line == opened.line
    return Cause(
        message=f"the `{bracket}` that opens here is never closed",
        span=Span.at(opened.source, opened.line, opened.column, len(written)),
        help=f"close it: `{written.rstrip(', ')}{_CLOSING[bracket]}`",
        related=None if is_near else Related(message="noticed here", span=trouble.span),
    )


def _closed_too_often(trouble: Trouble) -> Cause | None:
    if trouble.rest[:1] not in ("]", "}"):
        return None
    return Cause(
        message=f"this `{trouble.rest[0]}` closes nothing, none is open",
        span=trouble.span,
        help="take it out, or put the whole value in quotes",
    )


def _other_closing(opened: Span, trouble: Trouble) -> Cause | None:
    bracket = opened.text
    if trouble.rest[0] == _CLOSING[bracket]:
        return None
    return Cause(
        message=f"`{trouble.rest[0]}` stands where the `{bracket}` of line {opened.line} is open",
        span=trouble.span,
        help=f"close that with `{_CLOSING[bracket]}` first",
    )


def _no_comma(opened: Span, trouble: Trouble) -> Cause | None:
    if "expected ',' or" not in trouble.problem:
        return None
    place = trouble.span
    if trouble.rest[0] == ":":
        # The word before the colon is the next key, read as the end of the value before it.
        word = _LAST_WORD.search(trouble.text, 0, trouble.column - 1)
        start = opened.column if opened.line == trouble.line else 0
        if word is not None and word.start() >= start:
            place = Span.at(trouble.source, trouble.line, word.start() + 1, len(word[0].rstrip()))
    within = "braces" if opened.text == "{" else "brackets"
    return Cause(
        message=f"a comma is missing before `{place.text}`",
        span=place,
        help=f"the parts within {within} are separated by commas",
    )
