"""One `obk launch` of a rehearsal: start it, collect its events, query its status, stop it.

The launcher never outlives this process.
"""

import signal
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from obk_cli.clock import monotonic_s, wall_s
from obk_cli.faultinject.verdict import TimedEvent, parse_event
from obk_cli.process.child_process import BoundChild
from obk_cli.runs.orphans import end_orphans, find_orphans
from obk_cli.runs.protocol import StackStatus, ask_status
from obk_cli.runs.registry import live_folders

__all__ = ["LaunchedStack"]

LEFT_S: Final = 7.0
"""Limit for nodes to exit after their launcher; above the warden's limit [s]."""
OVER_S: Final = 1.0
"""Limit for the last output to arrive after the process has exited [s]."""
POLL_S: Final = 0.05
ANSWER_S: Final = 10.0
"""Limit for a reply over the control socket; its speed is not part of a verdict [s]."""


class LaunchedStack:
    """A launcher, from its start to its exit."""

    def __init__(
        self, command: Sequence[str], environment: Mapping[str, str], parent: Path
    ) -> None:
        """Start a launcher.

        Args:
            command: `obk launch ... --format json`.
            environment: its complete environment.
            parent: the folder in which it creates its run folder.
        """
        self._parent = parent
        self._changed = threading.Condition()
        self._events: list[TimedEvent] = []
        self._other_output: list[str] = []
        self._over_s: float | None = None
        self._run: Path | None = None
        self._child = BoundChild(
            command, environment, on_line=self._on_line, on_output_end=self._on_output_end
        )

    @property
    def events(self) -> tuple[TimedEvent, ...]:
        """The events that it has reported so far."""
        with self._changed:
            return tuple(self._events)

    @property
    def other_output(self) -> tuple[str, ...]:
        """The output lines that are not events."""
        with self._changed:
            return tuple(self._other_output)

    @property
    def exit_code(self) -> int | None:
        """None while it is running."""
        return self._child.exit_code

    @property
    def over_s(self) -> float | None:
        """When its output ended [s since 1970]; None until then."""
        return self._over_s

    @property
    def run(self) -> Path | None:
        """The run's folder; None until it is created."""
        if self._run is None:
            live = live_folders(self._parent)
            self._run = next((f for f, run in live.items() if run.pid == self._child.pid), None)
        return self._run

    def wait_until(
        self, holds: Callable[[tuple[TimedEvent, ...]], bool], timeout_s: float, *, since: int = 0
    ) -> bool:
        """Wait until the condition holds or the launcher exits; return whether the condition holds.

        Args:
            holds: the condition, evaluated after each event.
            timeout_s: maximum wait [s].
            since: how many of the first events to skip.
        """
        end = monotonic_s() + timeout_s
        with self._changed:
            while not (is_so := holds(tuple(self._events[since:]))) and self._over_s is None:
                left_s = end - monotonic_s()
                if left_s <= 0 or not self._changed.wait(left_s):
                    break
            return is_so or holds(tuple(self._events[since:]))

    def wait_for_end(self, timeout_s: float) -> int | None:
        """Wait for it to exit; return the exit code, or None if it has not ended in time."""
        code = self._child.wait(timeout_s)
        if code is not None:
            with self._changed:
                self._changed.wait_for(lambda: self._over_s is not None, OVER_S)
        return code

    def outcome(self, timeout_s: float) -> int | None:
        """The exit code, waiting for it if the output has ended; None while the stack runs."""
        # The kernel closes a process's output some time before it reports the exit.
        return self.exit_code if self._over_s is None else self.wait_for_end(timeout_s)

    def status(self) -> StackStatus | None:
        """The status that it reports; None if it does not reply."""
        return None if self.run is None else ask_status(self.run, ANSWER_S)

    def end(self, timeout_s: float) -> int | None:
        """Interrupt it and wait; return the exit code, or None if it had to be killed."""
        if self.exit_code is None:
            self._child.signal(signal.SIGINT)
        code = self.wait_for_end(timeout_s)
        self._child.close()
        return code

    def clear_up(self) -> tuple[str, ...]:
        """Terminate processes that outlived the launcher; return their commands."""
        if self._run is None:
            return ()
        end = monotonic_s() + LEFT_S
        while left := find_orphans(self._parent, run=self._run.name):
            if monotonic_s() > end:
                end_orphans(left)
                return tuple(process.command for process in left)
            self._pause()
        return ()

    def _pause(self) -> None:
        with self._changed:
            self._changed.wait(POLL_S)

    def _on_line(self, line: str) -> None:
        event = parse_event(line)
        with self._changed:
            if event is not None:
                self._events.append(event)
            elif not line.startswith("{"):
                self._other_output.append(line)
            self._changed.notify_all()

    def _on_output_end(self) -> None:
        with self._changed:
            self._over_s = wall_s()
            self._changed.notify_all()
