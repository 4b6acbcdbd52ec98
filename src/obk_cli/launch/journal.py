"""The log files of a run: events as JSON lines with time stamps, and the output of each node."""

import json
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import IO, Final

from obk_cli.launch.events import OUTPUT_EVENTS, OutputEvent

__all__ = ["Journal", "event_record", "output_record"]

_NAMES: Final[Mapping[type[OutputEvent], str]] = {k: name for name, k in OUTPUT_EVENTS.items()}


def event_record(event: OutputEvent, time_s: float) -> dict[str, object]:
    """An event as in `events.jsonl` and in the stream of `--format json`.

    Args:
        event: what happened.
        time_s: when [s since 1970].
    """
    return {"time": time_s, "event": _NAMES[type(event)], **asdict(event)}


def output_record(node: str, text: str, time_s: float) -> dict[str, object]:
    """A line of a node's output in the same form."""
    return {"time": time_s, "event": "Output", "node": node, "text": text}


class Journal:
    """The files of a run folder: `events.jsonl`, `launch.log`, and a log for each node.

    The first file that cannot be written is reported, and ends all writing; the run goes on.
    """

    def __init__(self, folder: Path | None, on_fault: Callable[[OSError], None]) -> None:
        """Write below a folder; None writes nothing. `on_fault` takes the first fault."""
        self._folder = folder
        self._on_fault = on_fault
        self._files: dict[str, IO[str]] = {}
        self._lock = threading.RLock()

    def event(self, event: OutputEvent, time_s: float) -> None:
        """Note an event and when it happened [s since 1970]."""
        self._write("events.jsonl", json.dumps(event_record(event, time_s)))

    def shown(self, text: str) -> None:
        """Note a line that the user sees."""
        self._write("launch.log", text)

    def line(self, node: str, text: str) -> None:
        """Note a line of a node's output, or of a process that nodes share."""
        self._write(f"{node.strip('/').replace('/', '.')}.log", text)

    def close(self) -> None:
        """Close the files; nothing is written after that."""
        with self._lock:
            self._folder = None
            for file in self._files.values():
                with suppress(OSError):
                    file.close()
            self._files.clear()

    def _write(self, name: str, text: str) -> None:
        with self._lock:
            if self._folder is None:
                return
            try:
                self._file(self._folder / name).write(text + "\n")
            except OSError as error:
                self.close()
                self._on_fault(error)

    def _file(self, path: Path) -> IO[str]:
        if path.name not in self._files:
            self._files[path.name] = path.open("a", buffering=1, encoding="utf-8", errors="replace")
        return self._files[path.name]
