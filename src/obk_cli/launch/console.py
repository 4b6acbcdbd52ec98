"""The console of a launch: log files and a screen, with a status area on a terminal, or JSON.

`Output` receives events and lines. `Screen` writes in its own thread and never blocks its callers.
If the output is read slowly, the screen keeps a bounded number of lines, and drops and counts the
rest. Lines that a full disk rejects are dropped in the same way.
"""

import errno
import os
import re
import select
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Final, Protocol, Self

from obk_cli.clock import monotonic_s, wall_s
from obk_cli.errors import ObkError
from obk_cli.files import explain_os_error
from obk_cli.launch.event_lines import Journal, JsonReport, LaunchReport
from obk_cli.launch.events import Ended, OutputEvent, OutputLine
from obk_cli.launch.process_groups import Unit
from obk_cli.launch.processes import LOG_PREFIX
from obk_cli.plan.plan import Plan
from obk_cli.terminal import plain

__all__ = [
    "Console",
    "Footer",
    "NodeLines",
    "Output",
    "Screen",
    "open_console",
    "takes_footer",
]

_STDERR: Final = 2
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_LAST_WORDS = re.compile(r"(/[\w/]+): ")
_TRACEBACK: Final = "Traceback (most recent call last):"
_CHAINED: Final = (
    "During handling of the above exception, another exception occurred:",
    "The above exception was the direct cause of the following exception:",
)


class NodeLines:
    """Finds the node that wrote each line of a stream."""

    def __init__(self, nodes: Iterable[str]) -> None:
        """Start with the nodes' full names, `/ns/name`."""
        self._by_logger: Mapping[str, str] = {
            node.strip("/").replace("/", "."): node for node in nodes
        }
        self.is_shared: Final = len(self._by_logger) > 1
        self._owner: str | None = None
        self._in_traceback = False

    def owner(self, line: str) -> str | None:
        """The node that wrote the next line of the stream; None: the process itself.

        A line without a logger's name belongs to the previous node if it is indented, blank, or
        part of a traceback.
        """
        text = _COLOUR.sub("", line)
        if logged := LOG_PREFIX.match(text):
            self._begin(self._of_logger(logged[1]))
        elif last := _LAST_WORDS.match(text):
            self._begin(self._by_logger.get(last[1].strip("/").replace("/", ".")))
        elif text == _TRACEBACK:
            self._in_traceback = True
        elif self._in_traceback and not _is_continued(text):
            # The exception itself, the last line of its traceback.
            self._in_traceback = False
        elif not _is_continued(text):
            self._begin(None)
        return self._owner

    def _begin(self, owner: str | None) -> None:
        self._owner = owner
        self._in_traceback = False

    def _of_logger(self, name: str) -> str | None:
        """The node of a logger: the logger's own, otherwise that of its nearest ancestor."""
        while name and name not in self._by_logger:
            name = name.rpartition(".")[0]
        return self._by_logger.get(name)


def _is_continued(text: str) -> bool:
    return not text.strip() or text[0].isspace() or text in _CHAINED


Draw = Callable[[int, int], Sequence[str]]
"""Columns and rows of the terminal -> lines that fit; they may contain colors, no other codes."""

ROOM: Final = 2000
"""Maximum number of waiting lines."""
END_S: Final = 1.0
"""Limit for writing the last lines at shutdown [s]."""
REFRESH_S: Final = 0.5
"""Refresh interval of a footer while no lines are written [s]."""
PAUSE_S: Final = 0.05
"""Minimum time between two writes above a footer, each of which redraws it [s]."""
SUMMARY_S: Final = 1.0
"""Interval of checks for summaries that are due [s]."""
NO_LOGS: Final = "no log files from here on"
_NO_ROOM: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_USUAL_SIZE: Final = os.terminal_size((80, 24))


def takes_footer(fd: int, term: str) -> bool:
    """Whether a descriptor is a terminal that can move its cursor; `term` is the variable TERM."""
    return term not in ("", "dumb") and os.isatty(fd)


class Footer:
    """A status area at the bottom of a terminal, with the cursor in the line below it.

    It returns the text that prints lines above it, and never writes itself. It uses nothing that
    would outlast a killed process: no hidden cursor, no alternate screen, no scroll region.
    """

    def __init__(self, fd: int, draw: Draw) -> None:
        """Call `draw` for the lines on every update, with the size that `fd` then has."""
        self._fd = fd
        self._draw = draw
        self._shown: tuple[str, ...] = ()

    def below(self, log: str) -> str:
        """The text that prints `log`, whole lines, above the footer; empty if nothing changed.

        Raises:
            OSError: the terminal no longer exists.
        """
        size = self._terminal_size()
        lines = tuple(self._draw(*size))[: max(0, size.lines - 1)]
        if not log and lines == self._shown:
            return ""
        erased = self._erased(size.columns)
        self._shown = lines
        return erased + log + "".join(f"{line}\n" for line in lines)

    def removed(self) -> str:
        """The text that removes the footer."""
        erased = self._erased(self._terminal_size().columns)
        self._shown = ()
        return erased

    def _terminal_size(self) -> os.terminal_size:
        size = os.get_terminal_size(self._fd)
        return size if size.columns and size.lines else _USUAL_SIZE

    def _erased(self, columns: int) -> str:
        """The sequence back to the area's start; a narrower terminal has wrapped its lines."""
        from rich.text import Text  # slow, and not needed without a terminal

        cells = (Text.from_ansi(line).cell_len for line in self._shown)
        rows = sum(max(1, -(-count // columns)) for count in cells)
        return f"\r\x1b[{rows}A\x1b[J" if rows else ""


def _left_out_line(count: int) -> str:
    return f"... {count} lines left out"


class Screen:
    """Writes lines to a descriptor."""

    def __init__(
        self, fd: int, room: int = ROOM, left_out: Callable[[int], str] = _left_out_line
    ) -> None:
        """Start the writing thread.

        Args:
            fd: where to write; not closed.
            room: maximum number of waiting lines.
            left_out: returns the line that reports the number of dropped lines.
        """
        self._fd = fd
        self._room = room
        self._left_out_line = left_out
        self._waiting: list[str | int] = []
        """Waiting lines; a number stands for that many dropped lines."""
        self._left_out = 0
        self._footer: Footer | None = None
        self._ending = threading.Event()
        self._is_closed = False
        self._on_closed: Callable[[], None] = lambda: None
        self._changed = threading.Condition()
        # Not through sys.stdout: a lock held by this thread would keep Python from exiting.
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
        """Write the waiting lines if they are read soon enough, and remove the footer."""
        with self._changed:
            self._ending.set()
            self._changed.notify()
        self._writer.join(END_S)

    def when_closed(self, call: Callable[[], None]) -> None:
        """Have `call` called, from a thread, once the output turns out to be closed."""
        with self._changed:
            self._on_closed = call
            if not self._is_closed:
                return
        call()

    def set_footer(self, draw: Draw) -> None:
        """Keep a status area below the lines from now on; requires `takes_footer`.

        Args:
            draw: returns its lines for a terminal's size; called often, in the writing thread.
        """
        with self._changed:
            self._footer = Footer(self._fd, draw)
            self._changed.notify()

    def put(self, line: str, *, may_drop: bool = False) -> None:
        """Write a line later; a droppable line is dropped while too many wait."""
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
        texts = (self._left_out_line(n) if isinstance(n, int) else n for n in lines)
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
            except BlockingIOError:  # another program has made the terminal non-blocking
                select.select([], [self._fd], [])

    def _taken(self) -> list[str | int] | None:
        """Wait for lines or the footer's next update, and take all lines; None once closed."""
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


class Formatter(Protocol):
    """Turns events and output into lines for the user."""

    def event(self, event: OutputEvent) -> Iterable[str]:
        """The lines for an event, as in the log."""

    def on_screen(self, event: OutputEvent, lines: Iterable[str], /) -> Iterable[str]:
        """Those of an event's lines that the screen shows when the event happens."""

    def due(self) -> Iterable[str]:
        """The lines that sum up what the screen has not shown; called once a second."""

    def line(self, node: str, text: str) -> Iterable[str]:
        """The lines for a line of a node's output; called from several threads."""

    def note(self, text: str) -> Iterable[str]:
        """The lines for a message of the launcher itself."""


class Output:
    """Writes events and the output of processes to the log files and the screen."""

    def __init__(
        self, run_folder: Path | None, screen: Screen, formatter: Formatter, units: Iterable[Unit]
    ) -> None:
        """Write to log files in a folder, if it is not None, and to a screen."""
        self._screen = screen
        # Keeps the order of lines, and ensures that nothing follows the last event on the screen.
        self._lock = threading.RLock()
        self._formatter = formatter
        self._writers = {unit.name: NodeLines(unit.node_names) for unit in units}
        self.journal = Journal(run_folder, self.unwritable)
        self._has_ended = False
        self._is_over = threading.Event()
        self._summing = threading.Thread(target=self._sum_up, name="summaries", daemon=True)

    def __enter__(self) -> Self:
        self._summing.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the log files; those of a run that could not start contain the reason."""
        self._is_over.set()
        if isinstance(error, ObkError):
            self.journal.shown(plain(f"failed: {error.message}"))
        self.journal.close()

    def event(self, event: OutputEvent) -> None:
        """Write an event."""
        self.journal.event(event, wall_s())
        with self._lock:
            lines = tuple(self._formatter.event(event))
            for text in lines:
                self.journal.shown(plain(text))
            for text in self._formatter.on_screen(event, lines):
                self._show(text)
            self._has_ended = self._has_ended or isinstance(event, Ended)

    def _sum_up(self) -> None:
        while not self._is_over.wait(SUMMARY_S):
            with self._lock:
                for text in self._formatter.due():
                    self._show(text)

    def line(self, line: OutputLine) -> None:
        """Write a line of a process; the recorder is not a node, so its lines are our own."""
        writers = self._writers.get(line.process)
        if writers is None:
            self.journal.line(line.process, line.text)
            self.note(line.text)
            return
        node = (writers.owner(line.text) if writers.is_shared else None) or line.process
        self.journal.line(node, line.text)
        with self._lock:
            for text in self._formatter.line(node, line.text):
                self.journal.shown(plain(text))
                self._show(text, may_drop=True)

    def note(self, text: str) -> None:
        """Write a message of the launcher itself."""
        with self._lock:
            for line in self._formatter.note(text):
                self.journal.shown(plain(line))
                self._show(line)

    def _show(self, text: str, *, may_drop: bool = False) -> None:
        if not self._has_ended:
            self._screen.put(text, may_drop=may_drop)

    def unwritable(self, error: OSError) -> None:
        """Report that log files can no longer be written."""
        self.note(f"warning: {NO_LOGS}: {explain_os_error(error)}")


class Console:
    """A screen, and the format of what it shows."""

    def __init__(
        self,
        screen: Screen,
        *,
        json: JsonReport | None,
        colour: bool,
        quiet: bool,
        takes_status: bool,
    ) -> None:
        """Use a JSON format if one is given, otherwise text."""
        self.screen = screen
        self._json = json
        self._colour = colour
        self._quiet = quiet
        self._takes_status = takes_status

    def formatter(self, plan: Plan, units: Iterable[Unit], *, leads: bool) -> Formatter:
        """The formatter for a run; also starts a status area if the screen supports one."""
        if self._json is not None:
            return self._json
        names = (node.full_name for node in plan.nodes)
        report = LaunchReport(names, colour=self._colour, quiet=self._quiet)
        if not self._takes_status:
            return report
        # Slow to import, and not needed without a terminal.
        from obk_cli.launch.status import LiveReport, opening_status

        opening = opening_status(plan, units, leads=leads)
        live = LiveReport(report, opening, clock=monotonic_s, colour=self._colour)
        self.screen.set_footer(live.draw)
        return live


@contextmanager
def open_console(
    fd: int, *, as_json: bool, colour: bool, quiet: bool, terminal: str
) -> Iterator[Console]:
    """Open a console on a descriptor.

    Args:
        fd: where to write.
        as_json: one JSON object per line.
        colour: whether lines may be colored.
        quiet: hide the nodes' output.
        terminal: the variable TERM.
    """
    if as_json:
        json = JsonReport(wall_s, quiet=quiet)
        with _own_copy(fd) as own, Screen(own, left_out=json.left_out) as screen:
            yield Console(screen, json=json, colour=colour, quiet=quiet, takes_status=False)
        return
    with Screen(fd) as screen:
        takes_status = takes_footer(fd, terminal)
        yield Console(screen, json=None, colour=colour, quiet=quiet, takes_status=takes_status)


@contextmanager
def _own_copy(fd: int) -> Iterator[int]:
    """A copy of a descriptor; what libraries write to the original goes to stderr.

    Fast DDS prints its errors on stdout, where they would be between the JSON lines.
    """
    own = os.dup(fd)
    try:
        with suppress(OSError):  # stderr is closed
            os.dup2(_STDERR, fd)
        yield own
    finally:
        os.dup2(own, fd)
        os.close(own)
