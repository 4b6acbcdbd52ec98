"""Where events and the nodes' output go: the run's files and the screen."""

import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from types import TracebackType
from typing import Final, Protocol, Self

from obk_cli.adapters.clock import wall_s
from obk_cli.adapters.node_lines import NodeLines
from obk_cli.adapters.screen import Screen
from obk_cli.errors import ObkError
from obk_cli.launch.events import OutputEvent
from obk_cli.launch.journal import Journal
from obk_cli.launch.process_groups import Unit
from obk_cli.report.escapes import plain

__all__ = ["Output", "Voice"]

NO_LOGS: Final = "no log files from here on"


class Voice(Protocol):
    """Turns what happens into lines for the user."""

    def event(self, event: OutputEvent) -> Iterable[str]:
        """The lines for an event."""

    def line(self, node: str, text: str) -> Iterable[str]:
        """The lines for one of a node's output; called from several threads."""

    def note(self, text: str) -> Iterable[str]:
        """The lines for a sentence of the launcher's own."""


class Output:
    """Takes what happens and what the processes write."""

    def __init__(
        self, run_folder: Path | None, screen: Screen, voice: Voice, units: Iterable[Unit]
    ) -> None:
        """Write below a folder, None: nowhere, and to a screen."""
        self._screen = screen
        # So that nothing comes after the last event.
        self._lock = threading.RLock()
        self._voice = voice
        self._listeners: list[Callable[[OutputEvent], None]] = []
        self._shared = {
            unit.name: NodeLines(unit.node_names) for unit in units if len(unit.nodes) > 1
        }
        self.journal = Journal(run_folder, self.unwritable)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the run's files; a run that could not begin tells them why."""
        if isinstance(error, ObkError):
            self.journal.shown(plain(f"failed: {error.message}"))
        self.journal.close()

    def also_to(self, listener: Callable[[OutputEvent], None]) -> None:
        """Somebody else wants to know what happens."""
        self._listeners.append(listener)

    def event(self, event: OutputEvent) -> None:
        """Something happened."""
        self.journal.event(event, wall_s())
        for listener in self._listeners:
            listener(event)
        with self._lock:
            for text in self._voice.event(event):
                self.journal.shown(plain(text))
                self._screen.put(text)

    def line(self, unit: str, line: str) -> None:
        """A process wrote a line."""
        shared = self._shared.get(unit)
        node = (shared.owner(line) if shared is not None else None) or unit
        self.journal.line(node, line)
        with self._lock:
            for text in self._voice.line(node, line):
                self.journal.shown(plain(text))
                self._screen.put(text, may_drop=True)

    def note(self, text: str) -> None:
        """A sentence of the launcher's own."""
        for line in self._voice.note(text):
            self.journal.shown(plain(line))
            self._screen.put(line)

    def unwritable(self, error: OSError) -> None:
        """Log files cannot be written any more."""
        self.note(f"warning: {NO_LOGS}: {error}")
