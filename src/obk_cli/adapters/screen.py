"""Lines for whoever reads this program's output; a reader that stalls or leaves holds up nobody.

Takes lines from any thread, never waits, and writes them in a thread of its own. While nobody
reads, a bounded number of lines is kept; what comes beyond that is counted and left out, and so is
what a full disk does not take.
On a terminal a status area may stand below the lines; it is drawn in that thread too.
"""

import errno
import os
import select
import threading
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Final, Self

from obk_cli.adapters.footer import Draw, Footer

__all__ = ["Screen"]

ROOM: Final = 2000
"""Lines that may wait."""
END_S: Final = 1.0
"""How long the last lines may take at the end [s]."""
REFRESH_S: Final = 0.5
"""How long a footer stays as it is while there are no lines [s]."""
PAUSE_S: Final = 0.05
"""Between two writes above a footer, which each draw it again [s]."""
_NO_ROOM: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def _told_left_out(count: int) -> str:
    return f"... {count} lines left out"


class Screen:
    """A descriptor that lines are written to."""

    def __init__(
        self, fd: int, room: int = ROOM, left_out: Callable[[int], str] = _told_left_out
    ) -> None:
        """Make a screen.

        Args:
            fd: where to write; stays open.
            room: how many lines may wait.
            left_out: words a line that tells how many were left out.
        """
        self._fd = fd
        self._room = room
        self._told_left_out = left_out
        self._waiting: list[str | int] = []
        """Lines, and in their place how many were left out."""
        self._left_out = 0
        self._footer: Footer | None = None
        self._ending = threading.Event()
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
        """Write what waits, as far as it is read soon, and take the footer away."""
        with self._changed:
            self._ending.set()
            self._changed.notify()
        self._writer.join(END_S)

    def when_closed(self, call: Callable[[], None]) -> None:
        """Call this, from a thread, when it turns out that nobody will read any more."""
        with self._changed:
            self._on_closed = call
            if not self._is_closed:
                return
        call()

    def set_footer(self, draw: Draw) -> None:
        """Keep a status area below the lines from now on; only for one that `takes_footer`.

        Args:
            draw: gives its lines for a terminal's size; called in the writing thread, often.
        """
        with self._changed:
            self._footer = Footer(self._fd, draw)
            self._changed.notify()

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
            self._waiting.append(self._left_out)
            self._left_out = 0

    def _write_all(self) -> None:
        try:
            while (lines := self._taken()) is not None:
                self._write_lines(lines)
                if self._footer:
                    self._ending.wait(PAUSE_S)
            if self._footer:
                self._write(self._footer.removed())
        except OSError:
            with self._changed:
                self._is_closed = True
                self._waiting.clear()
                call = self._on_closed
            call()

    def _write_lines(self, lines: Sequence[str | int]) -> None:
        texts = (self._told_left_out(n) if isinstance(n, int) else n for n in lines)
        log = "".join(f"{text}\n" for text in texts)
        try:
            self._write(self._footer.below(log) if self._footer else log)
        except OSError as error:
            if error.errno not in _NO_ROOM:
                raise
            with self._changed:
                self._left_out += sum(n if isinstance(n, int) else 1 for n in lines)

    def _write(self, text: str) -> None:
        data = memoryview(text.encode(errors="replace"))
        while data:
            try:
                data = data[os.write(self._fd, data) :]
            except BlockingIOError:  # a program on the same terminal has made it so
                select.select([], [self._fd], [])

    def _taken(self) -> list[str | int] | None:
        """All that waits, once there is any or the footer is due; None at the end."""
        with self._changed:
            footer = self._footer
            self._changed.wait_for(
                lambda: self._waiting or self._ending.is_set() or self._footer is not footer,
                REFRESH_S if footer else None,
            )
            if self._ending.is_set() and not self._waiting:
                return None
            self._note_left_out()
            taken, self._waiting = self._waiting, []
            return taken
