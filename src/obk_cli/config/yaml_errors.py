"""Explain why source text is not well-formed YAML, at the mistake's location (OBK003).

A parser detects many mistakes only several lines after they were made. `_CAUSES` lists the usual
ones, each as a function that finds its mistake or returns None; the first match is reported.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import yaml

from obelisk_spec.suggestions import with_number
from obk_cli.config.yaml_error_context import LONGEST_LINE, ErrorContext, indent_of, without_comment
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found
from obk_cli.diagnostics.source import SourceFile, Span

__all__ = ["explain_yaml_error", "template_braces"]


@dataclass(frozen=True, slots=True)
class _Cause:
    """The mistake, its location, and the fix."""

    message: str
    span: Span
    help: str | None = None
    related: Related | None = None


def explain_yaml_error(error: yaml.MarkedYAMLError, source: SourceFile) -> Diagnostic:
    """A finding at the cause if it is known, otherwise where the parser detected it."""
    at = ErrorContext.of(error, source)
    causes = _CAUSES if at.is_short else ()
    return _finding(next((found for cause in causes if (found := cause(at))), _as_noticed(at)))


def template_braces(key: Span) -> Diagnostic | None:
    """A finding if a key that is a mapping results from `{{ name }}`."""
    cause = _braces(key)
    return _finding(cause) if cause else None


def _finding(cause: _Cause) -> Diagnostic:
    related = (cause.related,) if cause.related else ()
    return found("OBK003", cause.message, cause.span, help=cause.help, related=related)


def _as_noticed(at: ErrorContext) -> _Cause:
    related = None
    if at.context and at.context_place and at.context_place[0] < at.line:
        related = Related(message=at.context, span=at.at(*at.context_place))
    return _Cause(f"not valid YAML: {at.problem}", at.span, None, related)


# Quotes


def _wrong_escape(at: ErrorContext) -> _Cause | None:
    r"""`"C:\demo"`."""
    if "quoted scalar" not in at.context or not at.context_place or "escape" not in at.problem:
        return None
    start = at.text.rfind("\\", 0, at.column + 1)
    written = at.text[start : start + 2] if start >= 0 else "\\"
    return _Cause(
        f"`{written}` is not a YAML escape sequence",
        at.at(at.line, max(start, 0) + 1, 2),
        "write a backslash as `\\\\` in double quotes, or use single quotes",
    )


def _open_quote(at: ErrorContext) -> _Cause | None:
    """`"text`, to the end of the file."""
    if "quoted scalar" not in at.context or not at.context_place:
        return None
    return _quote_from(at.at(*at.context_place), "is never closed")


def _quote_closed_later(at: ErrorContext) -> _Cause | None:
    """`"text`, closed by the quote that opens the next value."""
    quoted = _quoted_before(at)
    if quoted is None or quoted.end_line == quoted.line:
        return None
    return _quote_from(
        quoted,
        f"is closed only on line {quoted.end_line}, by a quote that was meant to open a string",
    )


def _text_after_quote(at: ErrorContext) -> _Cause | None:
    """`"a"b`, and `'robot's'`."""
    quoted = _quoted_before(at)
    if quoted is None:
        return None
    quote, inner = quoted.text[0], quoted.text[1:-1]
    rest = without_comment(at.text[quoted.end_column - 1 :])
    if quote == "'" and rest.endswith("'"):
        help = f'put text with an apostrophe in double quotes: `"{inner}\'{rest[:-1]}"`'
    elif quote == '"' and rest.endswith('"'):
        help = f"put text with a double quote in single quotes: `'{inner}\"{rest[:-1]}'`"
    else:
        help = f"quote the whole value: `{quote}{inner}{rest}{quote}`"
    message = f"`{rest.strip()}` follows the quote {quote} that ends the value"
    return _Cause(message, at.span, help)


def _quoted_before(at: ErrorContext) -> Span | None:
    """The quoted value that text follows directly."""
    scalar = at.before.scalar
    if scalar is None or at.before.is_plain or scalar.text[:1] not in ("'", '"'):
        return None
    between = at.text[scalar.end_column - 1 : at.column - 1]
    if at.line != scalar.end_line or between.strip():
        return None
    return None if at.rest[:1] in ("", ":", ",", "]", "}") else scalar


def _quote_from(place: Span, what: str) -> _Cause:
    line = place.source.line(place.line)
    quote = line[place.column - 1]
    written = without_comment(line[place.column - 1 :])
    value = written.rstrip(",]}")  # the quote goes before what closes a list around it
    closed = f"`{value}{quote}{written[len(value) :]}`"
    return _Cause(
        f"the quote {quote} opened here {what}",
        Span.at(place.source, place.line, place.column, max(len(written), 1)),
        f"close it: {closed}" if written.strip(quote) else None,
    )


# Characters with a meaning in YAML where text was meant, and spaces that are not ASCII spaces

_BLANKS: Final = {
    "\t": "a tab",
    "\u00a0": "a no-break space",
    "\u3000": "a wide space",
    "\u200b": "a zero-width space",
}
_BRACES: Final = re.compile(r":\s+(\{\{.*?\}\}\S*)")
_CONFLICT: Final = re.compile(r"(<{7}|={7}|>{7})(\s|$)")
_OFTEN_TEXT: Final = "@`%*&!|>?"


def _start_of_line(at: ErrorContext) -> _Cause | None:
    """A tab in the indentation, or a merge conflict marker."""
    for number in (at.line, at.line - 1, at.context_place and at.context_place[0]):
        if number:
            cause = _indentation(at, number) or _conflict(at, number)
            if cause is not None:
                return cause
    return None


def _indentation(at: ErrorContext, number: int) -> _Cause | None:
    text = at.source.line(number)
    indent = text[: indent_of(text)]
    wrong = re.search(r"[^ ]", indent) if indent else re.match("\u200b", text)
    if wrong is None or not text.strip():
        return None
    name = _BLANKS.get(wrong[0], f"U+{ord(wrong[0]):04X}")
    return _Cause(
        f"line {number} is indented with {name}, but YAML allows only spaces",
        at.at(number, wrong.start() + 1),
        "replace it with spaces; most editors can do this automatically",
    )


def _conflict(at: ErrorContext, number: int) -> _Cause | None:
    mark = _CONFLICT.match(at.source.line(number))
    if mark is None:
        return None
    return _Cause(
        f"`{mark[1]}` is left over from a merge conflict",
        at.at(number, 1, len(mark[1])),
        "keep one of the two versions and remove the conflict markers",
    )


def _template(at: ErrorContext) -> _Cause | None:
    """`{{ name }}`."""
    return _braces(at.span)


def _braces(span: Span) -> _Cause | None:
    """`{{ name }}` on the line of a location."""
    text = span.source.line(span.line)
    braces = _BRACES.search(text) if len(text) <= LONGEST_LINE else None
    if braces is None:
        return None
    return _Cause(
        f"`{braces[1]}` is not expanded, because a config is not a template",
        Span.at(span.source, span.line, braces.start(1) + 1, len(braces[1])),
        "write an environment variable as `${NAME}`; put literal braces in quotes",
    )


def _item_after_key(at: ErrorContext) -> _Cause | None:
    """`key: - item`."""
    column, value = _rejected_value(at)
    if value[:1] != "-" or not at.text[: column - 1].strip():
        return None
    return _Cause(
        "a list item cannot start on the same line as a key",
        at.at(at.line, column, len(value)),
        "put the item on the next line, or write the list as `[...]`",
    )


def _reserved_start(at: ErrorContext) -> _Cause | None:
    """`@`, `%` and similar at the start of a value, or `*` and `&` without a name."""
    column, value = _rejected_value(at)
    if not value or value[0] not in _OFTEN_TEXT:
        return None
    return _Cause(
        f"unquoted text cannot start with `{value[0]}`, which has a special meaning in YAML",
        at.at(at.line, column, len(value)),
        f"put it in quotes: `{_in_quotes(value)}`",
    )


def _rejected_value(at: ErrorContext) -> tuple[int, str]:
    """Column and text of a value whose first character the parser rejected; otherwise no text."""
    column = at.column
    if at.context.endswith(("alias", "anchor", "block scalar")) and at.context_place:
        column = at.context_place[1]
    elif "cannot start any token" not in at.problem and "not allowed" not in at.problem:
        return column, ""
    return column, without_comment(at.text[column - 1 :])


def _in_quotes(text: str) -> str:
    if '"' not in text and "\\" not in text:
        return f'"{text}"'
    return "'" + text.replace("'", "''") + "'"


# Brackets and braces

_CLOSING: Final = {"[": "]", "{": "}"}
_LAST_WORD: Final = re.compile(r"\S+\s*$")


def _extra_bracket(at: ErrorContext) -> _Cause | None:
    """`{a: b}}`."""
    if at.before.bracket is not None or at.rest[:1] not in ("]", "}"):
        return None
    message = f"this `{at.rest[0]}` has no matching opening bracket"
    return _Cause(message, at.span, "remove it, or quote the whole value")


def _open_bracket(at: ErrorContext) -> _Cause | None:
    """`[1, 2`, detected where the next line is no longer part of it."""
    opened = at.before.bracket
    if opened is None:
        return None
    opening = opened.source.line(opened.line)
    if at.line > opened.line:
        is_open = at.is_at_end or indent_of(at.text) <= indent_of(opening)
    else:
        is_open = not at.rest
    if not is_open:
        return None
    bracket = opening[opened.column - 1]
    written = without_comment(opening[opened.column - 1 :])
    is_near = at.is_at_end or at.line == opened.line
    return _Cause(
        f"the `{bracket}` opened here is never closed",
        Span.at(opened.source, opened.line, opened.column, len(written)),
        f"close it: `{written.rstrip(', ')}{_CLOSING[bracket]}`",
        None if is_near else Related(message="noticed here", span=at.span),
    )


def _other_bracket(at: ErrorContext) -> _Cause | None:
    """`{a: [1}`."""
    opened = at.before.bracket
    if opened is None or at.rest[:1] not in ("]", "}") or at.rest[0] == _CLOSING[opened.text]:
        return None
    return _Cause(
        f"found `{at.rest[0]}` while the `{opened.text}` of line {opened.line} is still open",
        at.span,
        f"close it with `{_CLOSING[opened.text]}` first",
    )


def _missing_comma(at: ErrorContext) -> _Cause | None:
    """`{a: b c: d}`."""
    opened = at.before.bracket
    if opened is None or at.rest[:1] in ("", "]", "}") or "expected ',' or" not in at.problem:
        return None
    place = at.span
    if at.rest[0] == ":":
        # The word before the colon is the next key, parsed as the end of the previous value.
        word = _LAST_WORD.search(at.text, 0, at.column - 1)
        start = opened.column if opened.line == at.line else 0
        if word is not None and word.start() >= start:
            place = at.at(at.line, word.start() + 1, len(word[0].rstrip()))
    within = "braces" if opened.text == "{" else "brackets"
    if at.rest[0] == "{" and at.text[: at.column - 1].endswith("$"):
        return _Cause(
            f"YAML does not allow `${{` within {within}",
            at.at(at.line, at.column - 1, 2),
            f"write the value without {within}, on lines of its own, or put a text in quotes: "
            '"${NAME}"',
        )
    help = f"separate the parts within {within} with commas"
    return _Cause(f"a comma is missing before `{place.text}`", place, help)


# Spaces and colons

_KEY: Final = r"[A-Za-z_][A-Za-z0-9_.]*"
_ITEM: Final = r"\s*(?:- +)*"
_GLUED_COLON: Final = re.compile(rf"{_ITEM}({_KEY}):(?!//)([^\s:].*?)(?:\s+#.*)?$")
_GLUED_DASH: Final = re.compile(rf"\s*(?:- +)*(-({_KEY}:(?:\s.*)?))$")
_KEY_ONLY: Final = re.compile(rf"{_ITEM}({_KEY})\s*(?:#.*)?$")
_OTHER_COLON: Final = re.compile(
    rf"{_ITEM}({_KEY})(?:\s*[=：]\s*|\s+)(\S.*?)(?:\s+#.*)?$"  # noqa: RUF001
)
_PAIR: Final = re.compile(rf"{_ITEM}({_KEY}):\s+(\S.*?)(?:\s+#.*)?$")
_NEXT_PAIR: Final = re.compile(rf",\s*{_KEY}:\s")
_NO_MAPPING_HERE: Final = "mapping values are not allowed"
_NO_COLON: Final = "could not find expected ':'"


def _missing_space(at: ErrorContext) -> _Cause | None:
    """`-item` and `key:value`, on any line since the last value."""
    first = at.before.scalar.line if at.before.scalar else at.line
    if at.context_place and "simple key" in at.context:
        first = min(first, at.context_place[0])
    for number in sorted({first, at.line - 1, at.line}):
        text = at.source.line(number)
        dash, colon = _GLUED_DASH.match(text), _GLUED_COLON.match(text)
        if dash is not None:
            place = at.at(number, dash.start(1) + 1)
            return _Cause("a space is missing after the dash", place, f"write `- {dash[2]}`")
        if colon is not None:
            place, help = at.at(number, colon.end(1) + 1), f"write `{colon[1]}: {colon[2]}`"
            return _Cause("a space is missing after the colon", place, help)
    return None


def _second_colon(at: ErrorContext) -> _Cause | None:
    """`key: value: x`: the second colon turns text into a mapping."""
    pair = _PAIR.match(at.text) if at.problem.startswith(_NO_MAPPING_HERE) else None
    if pair is None or at.column <= pair.end(1) + 1:
        return None
    value = pair[2]
    help = f"put text that contains `: ` in quotes: `{pair[1]}: {_in_quotes(value)}`"
    if _NEXT_PAIR.search(value):
        help = "put each key on its own line; put text that contains `: ` in quotes"
    message = f"the value of `{pair[1]}` contains a colon followed by a space"
    return _Cause(message, at.at(at.line, pair.start(2) + 1, len(value)), help)


def _missing_colon(at: ErrorContext) -> _Cause | None:
    """`key`, `key = value`, `key value`, and a full-width colon."""
    if not at.problem.startswith(_NO_COLON) or not at.context_place:
        return None
    number = at.context_place[0]
    text = at.source.line(number)
    key = _KEY_ONLY.match(text)
    pair = key or _OTHER_COLON.match(text)
    if pair is None:
        return None
    place = at.at(number, pair.start(1) + 1, len(pair[1]))
    if key is not None:
        return _Cause(f"`{key[1]}` has no colon", place, f"write `{key[1]}:`")
    is_wide = text[pair.end(1) :].lstrip().startswith("：")  # noqa: RUF001
    what = (
        f"the colon of `{pair[1]}` is a full-width character"
        if is_wide
        else f"`{pair[1]}` has no colon"
    )
    return _Cause(what, place, f"write `{pair[1]}: {pair[2]}`")


# Lines that start in a different column than their block

_DASHES: Final = re.compile(r"(\s*)((?:- +)*)")
_MOST_LINES: Final = 200
"""Maximum number of lines searched above the mistake."""

_Start = tuple[int, int, str]
"""Line, column and kind (dash or key) of what a line starts with."""


def _deeper_than_key(at: ErrorContext) -> _Cause | None:
    """A key below a value, indented more than the value's key: one of them is misplaced."""
    scalar = at.before.scalar
    if not at.problem.startswith(_NO_MAPPING_HERE) or scalar is None or not at.before.is_plain:
        return None
    if scalar.line >= at.line:
        return None
    above = _starts_of(at.source, scalar.line)[-1]
    column = indent_of(at.text) + 1
    outer = [start for start in _starts(at.source, scalar.line) if start[2] == "key"]
    if any(start[1] == column for start in outer[:1]):
        # The key matches the lines further up, so the line in between is misplaced.
        return _differs(at.source, (scalar.line, above[1]), outer[0][:2])
    return _differs(at.source, (at.line, column), above[:2])


def _item_among_keys(at: ErrorContext) -> _Cause | None:
    """`- item` in the column of keys."""
    if not _is_start_of_block(at) or _kind(at) != "dash" or at.context_place is None:
        return None
    if at.context_place[1] != at.column or any(
        start[1:] == (at.column, "dash") for start in _starts(at.source, at.line)
    ):
        return None
    return _Cause(
        "a list item (`-`) appears among the keys of a mapping",
        at.span,
        "a block is either a list or a mapping: start every entry with a dash, or none",
        Related(message="the mapping", span=at.at(*at.context_place)),
    )


def _other_column(at: ErrorContext) -> _Cause | None:
    """A line in a column in which no line above it starts."""
    if not _is_start_of_block(at):
        return None
    kind = _kind(at)
    near = [s for s in _starts(at.source, at.line) if s[2] == kind and s[1] != at.column]
    if not near:
        return _Cause(
            f"this line starts in column {at.column}, unlike any line above it",
            at.span,
            "all lines of a mapping or list must start in the same column",
        )
    line, column, _ = min(near, key=lambda s: (abs(s[1] - at.column), -s[0]))
    odd = _line_between(at, kind) if abs(column - at.column) > 2 else None
    if odd is not None:
        return _differs(at.source, *odd)
    return _differs(at.source, (at.line, at.column), (line, column))


def _is_start_of_block(at: ErrorContext) -> bool:
    """Whether the parser stopped at the first word of a line in block style."""
    is_block = at.context.startswith("while parsing a block") and bool(at.rest)
    is_first = indent_of(at.text) + 1 == at.column
    return is_block and is_first and not at.problem.startswith(_NO_MAPPING_HERE)


def _kind(at: ErrorContext) -> str:
    return "dash" if at.rest == "-" or at.rest.startswith("- ") else "key"


def _line_between(at: ErrorContext, kind: str) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """A line too far left that follows a line matching the location, and the matching line."""
    odd: tuple[int, int] | None = None
    for number in range(at.line - 1, max(at.line - 1 - _MOST_LINES, 0), -1):
        text = at.source.line(number)
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        for _, column, what in _starts_of(at.source, number):
            if (column, what) == (at.column, kind):
                return (odd, (number, column)) if odd else None
        if indent_of(text) + 1 < at.column:
            if odd is not None:
                return None
            odd = (number, indent_of(text) + 1)
    return None


def _differs(source: SourceFile, wrong: tuple[int, int], right: tuple[int, int]) -> _Cause:
    (line, column), (other, expected) = wrong, right
    way = "right" if column < expected else "left"
    return _Cause(
        f"this line starts in column {column}, but line {other} of the same block starts in "
        f"column {expected}",
        Span.at(source, line, column),
        f"move it {with_number(abs(expected - column), 'space')} to the {way}: all lines of a "
        "mapping or list must start in the same column",
        Related(message="the other line", span=Span.at(source, other, expected)),
    )


def _starts(source: SourceFile, line: int) -> Iterator[_Start]:
    """The starts of the lines above, nearest first, outer ones only."""
    narrowest = 10**9
    for number in range(line - 1, max(line - 1 - _MOST_LINES, 0), -1):
        text = source.line(number)
        if not text.strip() or text.lstrip().startswith("#") or indent_of(text) >= narrowest:
            continue
        for start in reversed(_starts_of(source, number)):
            if start[1] < narrowest or start[2] == "dash":
                yield start
        narrowest = indent_of(text)


def _starts_of(source: SourceFile, line: int) -> list[_Start]:
    """The dashes of a line, and the key after them."""
    match = _DASHES.match(source.line(line))
    assert match is not None  # the pattern also matches an empty line
    dashes = [(line, m.start() + match.end(1) + 1, "dash") for m in re.finditer("-", match[2])]
    return [*dashes, (line, match.end() + 1, "key")]


_CAUSES: Final[tuple[Callable[[ErrorContext], _Cause | None], ...]] = (
    _wrong_escape,
    _open_quote,
    _quote_closed_later,
    _text_after_quote,
    _start_of_line,
    _template,
    _item_after_key,
    _reserved_start,
    _extra_bracket,
    _open_bracket,
    _other_bracket,
    _missing_comma,
    _missing_space,
    _second_colon,
    _missing_colon,
    _deeper_than_key,
    _item_among_keys,
    _other_column,
)
"""In the order in which they are tried: a later cause may assume that earlier ones do not apply."""
