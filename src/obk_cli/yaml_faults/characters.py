"""Characters that mean something to YAML where text was meant, and blanks that are no spaces."""

import re

from obk_cli.source import Span
from obk_cli.yaml_faults.trouble import LONGEST_LINE, Cause, Trouble, indent_of, without_comment

__all__ = ["find_braces", "find_character", "in_quotes"]

_BRACES = re.compile(r":\s+(\{\{.*?\}\}\S*)")
_NAMES = {"\u00a0": "a no-break space", "\u3000": "a wide space", "\u200b": "a zero-width space"}
_CONFLICT = re.compile(r"(<{7}|={7}|>{7})(\s|$)")
_OFTEN_TEXT = "@`%*&!|>?"


def find_character(trouble: Trouble) -> Cause | None:
    """The mistake, if it is a character at the place or in the indentation."""
    for number in (
        trouble.line,
        trouble.line - 1,
        trouble.context_place and trouble.context_place[0],
    ):
        if number:
            cause = _indentation(trouble, number) or _conflict(trouble, number)
            if cause is not None:
                return cause
    return find_braces(trouble.span) or _starts_no_value(trouble)


def find_braces(span: Span) -> Cause | None:
    """`{{ name }}` on the line of a place: the language of templates, which a config is not in."""
    text = span.source.line(span.line)
    braces = _BRACES.search(text) if len(text) <= LONGEST_LINE else None
    if braces is None:
        return None
    return Cause(
        message=f"`{braces[1]}` is not filled in, a config is no template",
        span=Span.at(span.source, span.line, braces.start(1) + 1, len(braces[1])),
        help="an environment variable is written `${NAME}`; braces that are text go in quotes",
    )


def in_quotes(text: str) -> str:
    """The text as a value in quotes."""
    return (
        f'"{text}"' if '"' not in text and "\\" not in text else "'" + text.replace("'", "''") + "'"
    )


def _indentation(trouble: Trouble, number: int) -> Cause | None:
    text = trouble.source.line(number)
    indent = text[: indent_of(text)]
    wrong = re.search(r"[^ ]", indent) if indent else re.match("\u200b", text)
    if wrong is None or not text.strip():
        return None
    name = "a tab" if wrong[0] == "\t" else _NAMES.get(wrong[0], f"U+{ord(wrong[0]):04X}")
    return Cause(
        message=f"line {number} is indented with {name}, YAML takes only spaces",
        span=Span.at(trouble.source, number, wrong.start() + 1),
        help="put spaces in its place; editors can be set to do so by themselves",
    )


def _conflict(trouble: Trouble, number: int) -> Cause | None:
    mark = _CONFLICT.match(trouble.source.line(number))
    if mark is None:
        return None
    return Cause(
        message=f"`{mark[1]}` is left of a merge that met a conflict",
        span=Span.at(trouble.source, number, 1, len(mark[1])),
        help="keep one of the two versions, and take the marks out",
    )


def _starts_no_value(trouble: Trouble) -> Cause | None:
    """`@`, `%` and the like at the start of a value, or `*` and `&` without a name."""
    column = trouble.column
    if trouble.context.endswith(("alias", "anchor", "block scalar")) and trouble.context_place:
        column = trouble.context_place[1]
    elif "cannot start any token" not in trouble.problem and "not allowed" not in trouble.problem:
        return None
    value = without_comment(trouble.text[column - 1 :])
    if value[:1] == "-" and trouble.text[: column - 1].strip():
        return Cause(
            message="an item of a list cannot start behind a key, on its line",
            span=Span.at(trouble.source, trouble.line, column, len(value)),
            help="put the item on the next line, or write the list as `[...]`",
        )
    if not value or value[0] not in _OFTEN_TEXT:
        return None
    return Cause(
        message=f"text cannot start with `{value[0]}`, which means something else in YAML",
        span=Span.at(trouble.source, trouble.line, column, len(value)),
        help=f"put it in quotes: `{in_quotes(value)}`",
    )
