"""What went wrong in a text that is not YAML, in the user's words and at the right place.

PyYAML's errors and the source in, findings out.
"""

import re

import yaml

from obk_cli.diagnostics import Diagnostic, Related, found
from obk_cli.source import SourceFile, Span

__all__ = ["explain_yaml_error", "forbidden_character"]

_FORBIDDEN = re.compile(
    "[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]"
)
_NO_SPACE = re.compile(r"\s*(?:- +)*([A-Za-z_][A-Za-z0-9_]*):([^\s:/].*)?$")


def forbidden_character(source: SourceFile) -> Diagnostic | None:
    """The first character that YAML does not take, such as a control character."""
    wrong = _FORBIDDEN.search(source.text)
    if wrong is None:
        return None
    before = SourceFile.of(source.path, source.text[: wrong.start()]).lines
    return found(
        "OBK003",
        f"character U+{ord(wrong[0]):04X} cannot stand in YAML",
        Span.at(source, len(before), len(before[-1]) + 1),
        help='inside double quotes it can be written as an escape such as "\\x07"',
    )


def explain_yaml_error(error: yaml.MarkedYAMLError, source: SourceFile) -> Diagnostic:
    """A finding at the place that the error marks, with a hint for the usual causes."""
    mark = error.problem_mark or error.context_mark
    line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
    if line > len(source.lines):
        line, column = len(source.lines), len(source.lines[-1]) + 1
    column = min(column, len(source.line(line)) + 1)
    problem = error.problem or "the text ends too early"
    related: tuple[Related, ...] = ()
    if error.context and error.context_mark and error.context_mark.line + 1 < line:
        place = Span.at(source, error.context_mark.line + 1, error.context_mark.column + 1)
        related = (Related(message=error.context, span=place),)
    return found(
        "OBK003",
        f"not YAML: {problem}",
        Span.at(source, line, column),
        help=_hint(source, line, problem),
        related=related,
    )


def _hint(source: SourceFile, line: int, problem: str) -> str | None:
    """The usual causes, looked for on the marked line and the one before it."""
    for number in (line, line - 1):
        text = source.line(number)
        indent = text[: len(text) - len(text.lstrip())]
        if "\t" in indent:
            return f"line {number} is indented with a tab; YAML takes only spaces"
        glued = _NO_SPACE.match(text)
        if glued and glued[2]:
            return f"put a space after the colon: `{glued[1]}: {glued[2].strip()}`"
    if "mapping values are not allowed" in problem:
        return "is the line indented like those around it? text that holds `: ` needs quotes"
    if "block" in problem or "expected <block end>" in problem:
        return "the lines of one mapping or list must start in the same column"
    return None
