"""Errors of a message build; catch `InterfaceError` for all of them.

Each message is for the user: what is wrong, where, and what is expected.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

__all__ = [
    "BuildToolError",
    "CommandError",
    "DefinitionError",
    "DefinitionProblem",
    "DependencyError",
    "InterfaceError",
    "NoRosError",
    "PackageError",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class DefinitionProblem:
    """A mistake in a message definition; line and column count from 1."""

    path: Path
    line: int
    column: int
    sentence: str
    help: str = ""

    def __str__(self) -> str:
        """Return `path:line:col: sentence`, and the help on a second line."""
        text = f"{self.path}:{self.line}:{self.column}: {self.sentence}"
        return f"{text}\n  help: {self.help}" if self.help else text


class InterfaceError(Exception):
    """Base class of the errors of a message build."""


class PackageError(InterfaceError):
    """A package folder is missing, unreadable or incomplete."""


class DependencyError(InterfaceError):
    """A dependency is not found, or packages depend on each other in a cycle."""


class DefinitionError(InterfaceError):
    """Message definitions are invalid; `problems` lists all mistakes."""

    def __init__(self, problems: Sequence[DefinitionProblem]) -> None:
        super().__init__("\n".join(map(str, problems)))
        self.problems = tuple(problems)


class BuildToolError(InterfaceError):
    """The compiler, the Python headers or the ROS 2 generators are not installed.

    `fix` is a command that installs them; empty if `sentence` says what to do.
    """

    def __init__(self, sentence: str, *, fix: str = "") -> None:
        super().__init__(f"{sentence}: {fix}" if fix else sentence)
        self.sentence = sentence
        self.fix = fix


class NoRosError(BuildToolError):
    """The ROS 2 generators are not installed."""


class CommandError(InterfaceError):
    """A compiler or a generator failed; `output` is its output, `command` its command line."""

    def __init__(self, sentence: str, *, output: str, command: Sequence[str] = ()) -> None:
        words = (sentence, output.rstrip(), f"the command was: {' '.join(command)}")
        super().__init__("\n".join(word for word in words[: 3 if command else 2] if word))
        self.sentence = sentence
        self.output = output
        self.command = tuple(command)
