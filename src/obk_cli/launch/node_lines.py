"""Which node wrote a line of an output that several nodes share. Pure.

In: the nodes' full names, then the lines in order. Out: for each line a node, or None for the
process itself. Knows rclpy's console format and never changes a line.
"""

import re
from collections.abc import Iterable, Mapping
from typing import Final

__all__ = ["CONSOLE_FORMAT", "NodeLines"]

CONSOLE_FORMAT: Final = "[{severity}] [{time}] [{name}]: {message}"
"""As RCUTILS_CONSOLE_OUTPUT_FORMAT takes it; rcutils' own, which a user may have changed."""

_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_LOGGED = re.compile(r"\[(?:DEBUG|INFO|WARN|ERROR|FATAL)\] \[[\d.]+\] \[([^\]]*)\]: ")
_LAST_WORDS = re.compile(r"(/[\w/]+): ")
_TRACEBACK: Final = "Traceback (most recent call last):"
_CHAINED: Final = (
    "During handling of the above exception, another exception occurred:",
    "The above exception was the direct cause of the following exception:",
)


class NodeLines:
    """Takes lines one after another and gives the node that wrote each."""

    def __init__(self, nodes: Iterable[str]) -> None:
        """Know the nodes by their full names, `/ns/name`."""
        self._by_logger: Mapping[str, str] = {
            node.strip("/").replace("/", "."): node for node in nodes
        }
        self.is_shared: Final = len(self._by_logger) > 1
        self._owner: str | None = None
        self._in_traceback = False

    def owner(self, line: str) -> str | None:
        """The node that wrote the next line of the stream, None where it is the process itself.

        A line that names no logger belongs to the node before it if it is indented, blank, or part
        of a traceback.
        """
        text = _COLOUR.sub("", line)
        if logged := _LOGGED.match(text):
            self._begin(self._of_logger(logged[1]))
        elif last := _LAST_WORDS.match(text):
            self._begin(self._by_logger.get(last[1].strip("/").replace("/", ".")))
        elif text == _TRACEBACK:
            self._in_traceback = True
        elif self._in_traceback and not _is_continued(text):
            # The exception itself, which ends its traceback.
            self._in_traceback = False
        elif not _is_continued(text):
            self._begin(None)
        return self._owner

    def _begin(self, owner: str | None) -> None:
        self._owner = owner
        self._in_traceback = False

    def _of_logger(self, name: str) -> str | None:
        """The node of a logger: its own, or else the nearest one up of which it is a child."""
        while name and name not in self._by_logger:
            name = name.rpartition(".")[0]
        return self._by_logger.get(name)


def _is_continued(text: str) -> bool:
    return not text.strip() or text[0].isspace() or text in _CHAINED
