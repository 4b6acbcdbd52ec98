"""What happened in a run, as JSON lines with time stamps."""

import json
import threading
from dataclasses import asdict
from pathlib import Path
from typing import IO

from obk_cli.launch.events import Told

__all__ = ["Journal"]


class Journal:
    """The files of a run folder: `events.jsonl`, and a log for each node."""

    def __init__(self, folder: Path | None) -> None:
        """Write below a folder; None writes nothing."""
        self._folder = folder
        self._files: dict[str, IO[str]] = {}
        self._lock = threading.Lock()

    def event(self, event: Told, time_s: float) -> None:
        """Note an event.

        Args:
            event: what happened.
            time_s: when [s since 1970].
        """
        record = {"time": time_s, "event": type(event).__name__, **asdict(event)}
        self._write("events.jsonl", json.dumps(record))

    def line(self, node: str, text: str) -> None:
        """Note a line of a node's output."""
        self._write(f"{node.strip('/').replace('/', '.')}.log", text)

    def close(self) -> None:
        """Close the files."""
        with self._lock:
            for file in self._files.values():
                file.close()
            self._files.clear()

    def _write(self, name: str, text: str) -> None:
        if self._folder is None:
            return
        with self._lock:
            if name not in self._files:
                self._files[name] = (self._folder / name).open("a", buffering=1, encoding="utf-8")
            self._files[name].write(text + "\n")
