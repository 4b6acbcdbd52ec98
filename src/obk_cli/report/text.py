"""Findings for a person: the sentence, the line with the place underlined, related places, help."""

from collections import Counter
from collections.abc import Iterable, Iterator

from obk_cli.diagnostics import Diagnostic, Severity
from obk_cli.source import Span

__all__ = ["report_text", "summary"]

_COLOURS: dict[str, str] = {"error": "31", "warning": "33", "info": "36", "help": "32", "dim": "2"}
_SEVERITIES: tuple[Severity, ...] = ("error", "warning", "info")
_WIDEST = 160
"""Characters of a line that are shown."""


def report_text(diagnostics: Iterable[Diagnostic], *, colour: bool) -> str:
    """The findings one after another, an empty line between them."""
    paint = _Paint(colour)
    blocks = ("\n".join(_block(diagnostic, paint)) for diagnostic in diagnostics)
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
    if severity == "info":
        return f"{count} info"
    return f"{count} {severity}{'' if count == 1 else 's'}"


class _Paint:
    def __init__(self, colour: bool) -> None:
        self._colour = colour

    def __call__(self, role: str, text: str) -> str:
        return f"\x1b[{_COLOURS[role]}m{text}\x1b[0m" if self._colour else text


def _block(diagnostic: Diagnostic, paint: _Paint) -> Iterator[str]:
    kind = paint(diagnostic.severity, f"{diagnostic.severity}[{diagnostic.code}]")
    yield f"{diagnostic.span}: {kind}: {diagnostic.message}"
    places = [
        (diagnostic.span, diagnostic.severity),
        *((r.span, "dim") for r in diagnostic.related),
    ]
    width = max(len(str(span.line)) for span, _ in places)
    yield from _excerpt(diagnostic.span, width, paint, diagnostic.severity)
    for related in diagnostic.related:
        yield f"  {related.span}: {related.message}"
        yield from _excerpt(related.span, width, paint, "dim")
    if diagnostic.help:
        yield f"  {paint('help', 'help')}: {diagnostic.help}"


def _excerpt(span: Span, width: int, paint: _Paint, role: str) -> Iterator[str]:
    line = span.source.line(span.line).rstrip()
    if not line:
        return
    shown = line if len(line) <= _WIDEST else line[:_WIDEST] + "..."
    length = max(min(span.first_line_end, len(shown) + 1) - span.column, 1)
    # A tab stays a tab under itself, so that the mark stands where the text does.
    indent = "".join("\t" if char == "\t" else " " for char in shown[: span.column - 1])
    yield f"  {span.line:>{width}} | {shown}"
    if span.column <= len(shown) + 1:
        yield f"  {'':>{width}} | {indent}{paint(role, '^' * length)}"
