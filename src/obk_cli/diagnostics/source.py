"""The user's text and places in it.

Lines and columns count from 1, columns in characters. Imports nothing of ours, reads no file.
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
"""More text than any config has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceFile:
    """One text, by the path under which the user knows it."""

    path: str
    text: str = field(repr=False)
    lines: tuple[str, ...] = field(default=(), repr=False, compare=False)

    @classmethod
    def of(cls, path: str, text: str) -> "SourceFile":
        """A source whose lines are cut at LF, CRLF or CR, as YAML does."""
        lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
        return cls(path=path, text=text, lines=tuple(lines))

    def line(self, number: int) -> str:
        """The line of that number, empty past the end."""
        return self.lines[number - 1] if 0 < number <= len(self.lines) else ""


@dataclass(frozen=True, slots=True)
class Span:
    """A stretch of a source, its end exclusive."""

    source: SourceFile
    line: int
    column: int
    end_line: int
    end_column: int

    @classmethod
    def at(cls, source: SourceFile, line: int, column: int, length: int = 1) -> "Span":
        """A stretch within one line."""
        return cls(source, line, column, line, column + length)

    @property
    def path(self) -> str:
        """The path of the source."""
        return self.source.path

    @property
    def text(self) -> str:
        """What stands there, cut to its first line."""
        return self.source.line(self.line)[self.column - 1 : self.first_line_end - 1]

    @property
    def first_line_end(self) -> int:
        """Where the stretch ends on its first line: a column, exclusive."""
        if self.end_line == self.line:
            return self.end_column
        return max(len(self.source.line(self.line).rstrip()) + 1, self.column + 1)

    def holds(self, other: "Span") -> bool:
        """Whether another stretch starts in this one, in the same text."""
        start, end = (self.line, self.column), (self.end_line, self.end_column)
        return self.source == other.source and start <= (other.line, other.column) < end

    def __str__(self) -> str:
        return f"{self.path}:{self.line}:{self.column}"


def indent_of(line: str) -> int:
    """The spaces that a line starts with."""
    return len(line) - len(line.lstrip(" "))


def line_end_of(text: str) -> str:
    """How the first line of a text ends; LF where there is only one."""
    first = re.search(r"\r\n|\r|\n", text)
    return first[0] if first else "\n"


COMMAND_LINE = "<command line>"
"""The path of values that `--set` gave."""
