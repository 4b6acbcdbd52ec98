"""The closed family of faults a message build can end in.

Every error's text is a sentence for the user: what, where, and what would be right. Nothing
here ever prints or ends the process.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

__all__ = [
    "BuildToolError",
    "CommandError",
    "DefinitionError",
    "DependencyError",
    "InterfaceError",
    "PackageError",
    "Problem",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """One fault in the text of a message definition; line and column count from 1."""

    path: Path
    line: int
    column: int
    sentence: str
    help: str = ""

    def __str__(self) -> str:
        """Return `path:line:col: sentence`, with the help on a line of its own."""
        text = f"{self.path}:{self.line}:{self.column}: {self.sentence}"
        return f"{text}\n  help: {self.help}" if self.help else text


class InterfaceError(Exception):
    """Root of the family: catch this one."""


class PackageError(InterfaceError):
    """A folder is not the package it should be: missing, unreadable or incomplete."""


class DependencyError(InterfaceError):
    """A package that another one needs is nowhere, or packages need one another in a circle."""


class DefinitionError(InterfaceError):
    """Message definitions that cannot be built; `problems` lists all of them."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        super().__init__("\n".join(map(str, problems)))
        self.problems = tuple(problems)


class BuildToolError(InterfaceError):
    """The compiler, the Python headers or the ROS 2 generators are not installed."""


class CommandError(InterfaceError):
    """A compiler or a generator failed; `output` is what it said, `command` how it was called."""

    def __init__(self, sentence: str, *, output: str, command: Sequence[str] = ()) -> None:
        words = (sentence, output.rstrip(), f"the command was: {' '.join(command)}")
        super().__init__("\n".join(word for word in words[: 3 if command else 2] if word))
        self.sentence = sentence
        self.output = output
        self.command = tuple(command)
