"""Edits of a source as values: which stretch is replaced by which text.

Sources and edits in, a new text out; what no edit names stays byte for byte. Writes no file.
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
    """A stretch, and what is to stand there instead; an empty stretch is an insertion."""

    span: Span
    text: str

    @property
    def place(self) -> Span:
        """The stretch, its end not past that of the text: a last line may have no end."""
        span, lines = self.span, self.span.source.lines
        if span.end_line <= len(lines):
            return span
        return Span(span.source, span.line, span.column, len(lines), len(lines[-1]) + 1)


@dataclass(frozen=True, slots=True)
class Offsets:
    """Lines and columns of a source as offsets into its text, and back."""

    source: SourceFile
    _starts: list[int] = field(repr=False)

    @classmethod
    def of(cls, source: SourceFile) -> "Offsets":
        """The offsets of a source; its lines end as those of `SourceFile` do."""
        return cls(source, [0, *(end.end() for end in _LINE_END.finditer(source.text))])

    def at(self, line: int, column: int = 1) -> int:
        """The offset of a place; the end of the text for a place past it."""
        if line > len(self._starts):
            return len(self.source.text)
        return min(self._starts[line - 1] + column - 1, len(self.source.text))

    def start(self, span: Span) -> int:
        """Where a stretch starts."""
        return self.at(span.line, span.column)

    def end(self, span: Span) -> int:
        """Where a stretch ends, exclusive."""
        return self.at(span.end_line, span.end_column)

    def span(self, start: int, end: int) -> Span:
        """The stretch between two offsets."""
        return Span(self.source, *self._place(start), *self._place(end))

    def edit(self, start: int, end: int, text: str = "") -> Edit:
        """The edit that puts `text` between two offsets, by default nothing."""
        return Edit(self.span(start, end), text)

    def insert(self, at: int, text: str) -> Edit:
        """The edit that puts `text` at an offset and takes nothing away."""
        return self.edit(at, at, text)

    def _place(self, offset: int) -> tuple[int, int]:
        line = bisect_right(self._starts, offset)
        return line, offset - self._starts[line - 1] + 1


def apply_edits(source: SourceFile, edits: Iterable[Edit]) -> str:
    """The text with every edit made, the same edit once; what two take away is gone.

    Raises:
        ValueError: two edits want the same stretch and one of them puts text there.
    """
    offsets = Offsets.of(source)
    placed = sorted({(offsets.start(e.span), offsets.end(e.span), e.text) for e in edits})
    parts: list[str] = []
    done, put = 0, ""
    for start, end, text in placed:
        if start < done and (text or put):
            raise ValueError(f"{offsets.span(start, end)}: two edits of one stretch")
        parts += (source.text[done:start], text)
        done, put = max(done, end), text
    return "".join((*parts, source.text[done:]))


def touched_lines(edits: Iterable[Edit]) -> set[tuple[str, int]]:
    """The lines that edits change, by file; edits without a common line are independent."""
    return {(e.span.path, line) for e in edits for line in range(e.span.line, e.span.end_line + 1)}
