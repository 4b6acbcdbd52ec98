"""Edits of a source as values: a span and the text that replaces it.

Applying edits to a source returns new text, in which all other bytes are unchanged. Nothing is
written to disk.
"""

import re
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, field

from obk_cli.diagnostics.source import SourceFile, Span

__all__ = ["Edit", "Offsets", "apply_edits", "touched_lines"]

_LINE_END = re.compile(r"\r\n|\r|\n")


@dataclass(frozen=True, slots=True)
class Edit:
    """A span and its replacement; an empty span is an insertion."""

    span: Span
    text: str

    @property
    def place(self) -> Span:
        """The span, with its end moved to the end of the text if it is past it."""
        span, lines = self.span, self.span.source.lines
        if span.end_line <= len(lines):
            return span
        return Span(span.source, span.line, span.column, len(lines), len(lines[-1]) + 1)


@dataclass(frozen=True, slots=True)
class Offsets:
    """Converts lines and columns of a source to offsets into its text, and back."""

    source: SourceFile
    _starts: list[int] = field(repr=False)

    @classmethod
    def of(cls, source: SourceFile) -> "Offsets":
        """The offsets of a source, with line ends as in `SourceFile`."""
        return cls(source, [0, *(end.end() for end in _LINE_END.finditer(source.text))])

    def at(self, line: int, column: int = 1) -> int:
        """The offset of a position; the end of the text if the position is past it."""
        if line > len(self._starts):
            return len(self.source.text)
        return min(self._starts[line - 1] + column - 1, len(self.source.text))

    def start(self, span: Span) -> int:
        """The offset at which a span starts."""
        return self.at(span.line, span.column)

    def end(self, span: Span) -> int:
        """The offset at which a span ends, exclusive."""
        return self.at(span.end_line, span.end_column)

    def span(self, start: int, end: int) -> Span:
        """The span between two offsets."""
        return Span(self.source, *self._place(start), *self._place(end))

    def edit(self, start: int, end: int, text: str = "") -> Edit:
        """The edit that replaces the text between two offsets, by default with nothing."""
        return Edit(self.span(start, end), text)

    def insert(self, at: int, text: str) -> Edit:
        """The edit that inserts `text` at an offset."""
        return self.edit(at, at, text)

    def _place(self, offset: int) -> tuple[int, int]:
        line = bisect_right(self._starts, offset)
        return line, offset - self._starts[line - 1] + 1


def apply_edits(source: SourceFile, edits: Iterable[Edit]) -> str:
    """Apply every edit once; overlapping deletions are merged.

    Raises:
        ValueError: two edits overlap, and one of them inserts text.
    """
    offsets = Offsets.of(source)
    placed = sorted({(offsets.start(e.span), offsets.end(e.span), e.text) for e in edits})
    parts: list[str] = []
    done, put = 0, ""
    for start, end, text in placed:
        if start < done and (text or put):
            raise ValueError(f"{offsets.span(start, end)}: overlapping edits")
        parts += (source.text[done:start], text)
        done, put = max(done, end), text
    return "".join((*parts, source.text[done:]))


def touched_lines(edits: Iterable[Edit]) -> set[tuple[str, int]]:
    """File and number of each line that edits change; edits that share no line are independent."""
    return {(e.span.path, line) for e in edits for line in range(e.span.line, e.span.end_line + 1)}
