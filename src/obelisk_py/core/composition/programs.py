"""Read the programs of a composed process from the file that the launcher wrote, and run them.

In: JSON, `{"nodes": [{"node", "module", "function", "arguments"}, ...]}`. Out: typed values, and a
way to run one of them as its own process would. Imports nothing of the user's before that.
"""

import json
import runpy
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from operator import attrgetter
from pathlib import Path

__all__ = ["Program", "logger_name", "read_programs"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """One node's program."""

    node: str
    """The node's full name, `/ns/name`."""
    module: str
    function: str | None
    """Called without arguments, as a console script is; None runs the module as a program."""
    arguments: tuple[str, ...]
    """The command line without the program's name."""

    def __str__(self) -> str:
        return f"{self.module}:{self.function}()" if self.function else f"python -m {self.module}"

    def run(self) -> None:
        """Run the program to its end, as a process of its own would.

        Raises:
            SystemExit: with its exit code.
            BaseException: any exception of the program.
        """
        with self.command_line():
            if self.function is None:
                runpy.run_module(self.module, run_name="__main__", alter_sys=True)
                sys.exit(0)
            sys.exit(attrgetter(self.function)(import_module(self.module))())

    @contextmanager
    def command_line(self) -> Iterator[None]:
        """While entered, `sys.argv` is this program's."""
        before = sys.argv
        sys.argv = [self.module, *self.arguments]
        try:
            yield
        finally:
            sys.argv = before


def read_programs(path: Path) -> tuple[Program, ...]:
    """The programs that a file lists.

    Raises:
        OSError: the file cannot be read.
        ValueError, KeyError: it was not written by the launcher.
    """
    return tuple(
        Program(
            node=entry["node"],
            module=entry["module"],
            function=entry["function"],
            arguments=tuple(entry["arguments"]),
        )
        for entry in json.loads(path.read_text(encoding="utf-8"))["nodes"]
    )


def logger_name(node: str) -> str:
    """The logger of a node, by its full name: `/ns/name` -> `ns.name`."""
    return node.strip("/").replace("/", ".")
