"""JSON with comments, as editors keep their settings: read, and one member set in its text.

Text in; a value, or a new text in which everything else stands as it was. Touches no file.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass

from obk_cli.diagnostics.source import line_end_of

__all__ = ["JsoncError", "read_jsonc", "set_member"]

_TOKEN = re.compile(
    r"""(?P<skip>\s+|//[^\r\n]*|/\*.*?\*/)|(?P<text>"(?:[^"\\\r\n]|\\.)*")"""
    r"""|(?P<mark>[{}\[\],:])|(?P<word>[^\s{}\[\],:"/]+)""",
    re.DOTALL,
)
_NO_LINE_END = re.compile(r"[^\r\n]")
_FIRST_INDENT = re.compile(r"\{\s*?\n([ \t]+)")
_USUAL_INDENT = "    "


class JsoncError(ValueError):
    """The text is not JSON, comments and last commas aside, or holds no place for the member."""


@dataclass(frozen=True, slots=True)
class _Token:
    kind: str
    text: str
    start: int
    end: int


def read_jsonc(text: str) -> object:
    """The value of a text; comments and commas after a last item do not count.

    Raises:
        JsoncError: it is not JSON otherwise.
    """
    try:
        return json.loads("".join(_plain_parts(text)))
    except (ValueError, RecursionError) as error:
        raise JsoncError(str(error)) from error


def set_member(text: str, path: tuple[str, ...], value: object) -> str:
    """The text with the member at `path` of its objects set; missing objects are made.

    Raises:
        JsoncError: the text is not JSON, or something on the way is no object.
    """
    read_jsonc(text)
    tokens = list(_tokens(text))
    at = 0
    for depth, key in enumerate(path):
        if tokens[at].text != "{":
            raise JsoncError(f"`{'.'.join(path[:depth]) or 'the file'}` is no object")
        found = _find(tokens, at, key)
        if found is None:
            for missing in reversed(path[depth + 1 :]):
                value = {missing: value}
            return _inserted(text, tokens[at], tokens[at + 1], key, value, depth + 1)
        at = found
    last = tokens[_skip(tokens, at) - 1]
    return text[: tokens[at].start] + _dumped(value, text, len(path)) + text[last.end :]


def _tokens(text: str) -> Iterator[_Token]:
    text = text.removeprefix("\ufeff").rjust(len(text))
    at = 0
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            raise JsoncError(f"character {at + 1}, `{text[at]}`, cannot stand there")
        at = match.end()
        if match.lastgroup != "skip":
            yield _Token(str(match.lastgroup), match[0], match.start(), at)


def _plain_parts(text: str) -> Iterator[str]:
    """The text with blanks for what JSON does not have, so that every place stays what it is."""
    tokens = list(_tokens(text))
    at = 0
    for token, after in zip(tokens, [*tokens[1:], None], strict=True):
        is_last_comma = token.text == "," and after is not None and after.text in "}]"
        yield _NO_LINE_END.sub(" ", text[at : token.start])
        yield " " if is_last_comma else token.text
        at = token.end


def _find(tokens: list[_Token], at: int, key: str) -> int | None:
    """The first token of the value of `key` in the object that starts at `at`."""
    found = None
    at += 1
    while tokens[at].text != "}":
        if tokens[at].text == ",":
            at += 1
            continue
        if json.loads(tokens[at].text) == key:
            found = at + 2
        at = _skip(tokens, at + 2)
    return found


def _skip(tokens: list[_Token], at: int) -> int:
    """The token after the value that starts at `at`."""
    depth = 0
    while True:
        depth += (tokens[at].text in ("{", "[")) - (tokens[at].text in ("}", "]"))
        at += 1
        if depth == 0:
            return at


def _inserted(text: str, brace: _Token, after: _Token, key: str, value: object, depth: int) -> str:
    """As the first member: what stands there, comments too, comes behind it."""
    end = line_end_of(text)
    member = f"{end}{_indent(text) * depth}{json.dumps(key)}: {_dumped(value, text, depth)}"
    rest = text[brace.end :]
    if after.text != "}":
        member += ","
    elif not rest[: after.start - brace.end].strip():
        rest = end + _indent(text) * (depth - 1) + text[after.start :]
    return text[: brace.end] + member + rest


def _dumped(value: object, text: str, depth: int) -> str:
    indent = _indent(text)
    lines = json.dumps(value, indent=indent, ensure_ascii=False).split("\n")
    end = line_end_of(text)
    return f"{end}{indent * depth}".join(lines)


def _indent(text: str) -> str:
    first = _FIRST_INDENT.search(text)
    return first[1] if first else _USUAL_INDENT
