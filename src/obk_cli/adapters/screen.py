"""Lines for whoever reads this program's output; a reader that stalls or leaves holds up nobody.

Takes lines from any thread, never waits, and writes them in a thread of its own. While nobody
reads, a bounded number of lines is kept; what comes beyond that is counted and left out.
"""

import os
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Final, Self

__all__ = ["Screen"]

ROOM: Final = 2000
"""Lines that may wait."""
END_S: Final = 1.0
"""How long the last lines may take at the end [s]."""


class Screen:
    """A descriptor that lines are written to."""

    def __init__(self, fd: int, room: int = ROOM) -> None:
        """Write to a descriptor, which stays open; `room` is how many lines may wait."""
        self._fd = fd
        self._room = room
        self._waiting: list[str] = []
        self._left_out = 0
        self._is_ending = False
        self._is_closed = False
        self._on_closed: Callable[[], None] = lambda: None
        self._changed = threading.Condition()
        # Not through sys.stdout: a lock that this thread holds there would stop Python from ending.
        self._writer = threading.Thread(target=self._write_all, name="screen", daemon=True)
        self._writer.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Write what waits, as far as it is read soon."""
        with self._changed:
            self._is_ending = True
            self._changed.notify()
        self._writer.join(END_S)

    def when_closed(self, call: Callable[[], None]) -> None:
        """Call this, from a thread, when it turns out that nobody will read any more."""
        with self._changed:
            self._on_closed = call
            if not self._is_closed:
                return
        call()

    def put(self, line: str, *, may_drop: bool = False) -> None:
        """Write a line, some time; one that may be dropped is, while too many wait."""
        with self._changed:
            if self._is_closed:
                return
            if may_drop and len(self._waiting) >= self._room:
                self._left_out += 1
                return
            self._note_left_out()
            self._waiting.append(line)
            self._changed.notify()

    def _note_left_out(self) -> None:
        if self._left_out:
            self._waiting.append(f"... {self._left_out} lines left out")
            self._left_out = 0

    def _write_all(self) -> None:
        try:
            while lines := self._taken():
                data = memoryview("".join(f"{line}\n" for line in lines).encode(errors="replace"))
                while data:
                    data = data[os.write(self._fd, data) :]
        except OSError:
            with self._changed:
                self._is_closed = True
                self._waiting.clear()
                call = self._on_closed
            call()

    def _taken(self) -> list[str]:
        """All that waits, once there is any; nothing at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._is_ending)
            self._note_left_out()
            taken, self._waiting = self._waiting, []
            return taken
