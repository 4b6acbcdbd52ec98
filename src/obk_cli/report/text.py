"""Findings for a person: the sentence, the line with the place underlined, related places, help.

Of an info only the sentence, unless more is asked for.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import groupby

from obelisk_spec.suggestions import with_number
from obk_cli.diagnostics.diagnostic import Diagnostic, Severity
from obk_cli.diagnostics.source import Span
from obk_cli.terminal import visible

__all__ = ["report_text", "summary"]

_COLOURS: dict[str, str] = {"error": "31", "warning": "33", "info": "36", "help": "32", "dim": "2"}
_SEVERITIES: tuple[Severity, ...] = ("error", "warning", "info")
_CONTROL = re.compile("[\\x00-\\x1f\\x7f-\\x9f\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069]")
_WIDEST = 160
"""Characters of a line that are shown."""


def report_text(diagnostics: Iterable[Diagnostic], *, colour: bool, verbose: bool = False) -> str:
    """The findings one after another, an empty line around those of several lines."""
    paint = _Paint(colour)
    groups = groupby(diagnostics, key=lambda d: d.severity == "info" and not verbose)
    blocks: list[str] = []
    for is_short, group in groups:
        if is_short:
            blocks.append("\n".join(_headline(diagnostic, paint) for diagnostic in group))
        else:
            blocks += ("\n".join(_block(diagnostic, paint)) for diagnostic in group)
    return "\n\n".join(blocks)


def summary(paths: Iterable[str], diagnostics: Iterable[Diagnostic], *, colour: bool) -> str:
    """One line: what was looked at and how much was found."""
    counts = Counter(diagnostic.severity for diagnostic in diagnostics)
    files = list(paths)
    where = files[0] if len(files) == 1 else f"{len(files)} files"
    paint = _Paint(colour)
    parts = [
        paint(severity, _counted(severity, counts[severity]))
        for severity in _SEVERITIES
        if counts[severity]
    ]
    return f"{where}: {', '.join(parts) if parts else paint('help', 'no findings')}"


def _counted(severity: Severity, count: int) -> str:
    return f"{count} info" if severity == "info" else with_number(count, severity)


class _Paint:
    def __init__(self, colour: bool) -> None:
        self._colour = colour

    def __call__(self, role: str, text: str) -> str:
        return f"\x1b[{_COLOURS[role]}m{text}\x1b[0m" if self._colour else text


def _block(diagnostic: Diagnostic, paint: _Paint) -> Iterator[str]:
    yield _headline(diagnostic, paint)
    places = [
        (diagnostic.span, diagnostic.severity),
        *((r.span, "dim") for r in diagnostic.related),
    ]
    width = max(len(str(span.line)) for span, _ in places)
    yield from _excerpt(diagnostic.span, width, paint, diagnostic.severity)
    for related in diagnostic.related:
        yield f"  {_on_one_line(f'{related.span}: {related.message}')}"
        yield from _excerpt(related.span, width, paint, "dim")
    if diagnostic.help:
        yield f"  {paint('help', 'help')}: {_on_one_line(diagnostic.help)}"


def _headline(diagnostic: Diagnostic, paint: _Paint) -> str:
    kind = paint(diagnostic.severity, f"{diagnostic.severity}[{diagnostic.code}]")
    place, message = _on_one_line(str(diagnostic.span)), _on_one_line(diagnostic.message)
    return f"{place}: {kind}: {message}"


def _on_one_line(text: str) -> str:
    """The text with control characters of the user's values written out."""
    return _CONTROL.sub(lambda char: char[0].encode("unicode_escape").decode(), text)


def _excerpt(span: Span, width: int, paint: _Paint, role: str) -> Iterator[str]:
    line = span.source.line(span.line).rstrip()
    if not line:
        return
    shown, column = _window(line, span)
    length = max(min(span.first_line_end - span.column, len(shown) + 1 - column), 1)
    # A tab stays a tab under itself, so that the mark stands where the text does.
    indent = "".join("\t" if char == "\t" else " " for char in shown[: column - 1])
    yield f"  {span.line:>{width}} | {visible(shown)}"
    if column <= len(shown) + 1:
        yield f"  {'':>{width}} | {indent}{paint(role, '^' * length)}"


def _window(line: str, span: Span) -> tuple[str, int]:
    """The part of a line that is shown, and the column in it where the stretch begins."""
    end = min(span.first_line_end - 1, span.column - 1 + _WIDEST // 2)
    start = max(0, min(end + _WIDEST // 4, len(line)) - _WIDEST) if end > _WIDEST else 0
    before = "..." if start else ""
    after = "..." if start + _WIDEST < len(line) else ""
    shown = before + line[start : start + _WIDEST] + after
    return shown, span.column - start + len(before)
