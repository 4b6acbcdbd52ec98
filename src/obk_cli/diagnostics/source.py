"""The user's text and locations in it.

Lines and columns count from 1; columns are in characters. This module does not import other modules
of obk or read files.
"""

import re
from dataclasses import dataclass, field

__all__ = [
    "COMMAND_LINE",
    "LONGEST_FILE_BYTES",
    "SourceFile",
    "Span",
    "indent_of",
    "line_end_of",
]

LONGEST_FILE_BYTES = 10 * 1024 * 1024
"""Size limit; no config is longer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceFile:
    """Source text, with the path under which the user knows it."""

    path: str
    text: str = field(repr=False)
    lines: tuple[str, ...] = field(default=(), repr=False, compare=False)

    @classmethod
    def of(cls, path: str, text: str) -> "SourceFile":
        """Create a source; lines end with LF, CRLF or CR, as in YAML."""
        lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
        return cls(path=path, text=text, lines=tuple(lines))

    def line(self, number: int) -> str:
        """The line with this number; empty past the end."""
        return self.lines[number - 1] if 0 < number <= len(self.lines) else ""


@dataclass(frozen=True, slots=True)
class Span:
    """A part of a source; its end is exclusive."""

    source: SourceFile
    line: int
    column: int
    end_line: int
    end_column: int

    @classmethod
    def at(cls, source: SourceFile, line: int, column: int, length: int = 1) -> "Span":
        """Create a span within one line."""
        return cls(source, line, column, line, column + length)

    @property
    def path(self) -> str:
        """The path of the source."""
        return self.source.path

    @property
    def text(self) -> str:
        """The text of the span, up to the end of its first line."""
        return self.source.line(self.line)[self.column - 1 : self.first_line_end - 1]

    @property
    def first_line_end(self) -> int:
        """The column at which the span ends on its first line, exclusive."""
        if self.end_line == self.line:
            return self.end_column
        return max(len(self.source.line(self.line).rstrip()) + 1, self.column + 1)

    def holds(self, other: "Span") -> bool:
        """Whether another span of the same text starts within this one."""
        start, end = (self.line, self.column), (self.end_line, self.end_column)
        return self.source == other.source and start <= (other.line, other.column) < end

    def __str__(self) -> str:
        return f"{self.path}:{self.line}:{self.column}"


def indent_of(line: str) -> int:
    """Number of spaces at the start of a line."""
    return len(line) - len(line.lstrip(" "))


def line_end_of(text: str) -> str:
    """Line end of the first line of the text; LF if there is only one line."""
    first = re.search(r"\r\n|\r|\n", text)
    return first[0] if first else "\n"


COMMAND_LINE = "<command line>"
"""Path of values given with `--set`."""
