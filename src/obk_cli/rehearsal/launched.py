"""One `obk launch` of a rehearsal: started, listened to, asked, ended; it never outlives this one.

Takes the command, gives what the launcher told and what is known of it otherwise.
"""

import signal
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from obk_cli.adapters.bound_process import BoundProcess
from obk_cli.adapters.clock import monotonic_s, wall_s
from obk_cli.adapters.leftovers import end_leftovers, find_leftovers
from obk_cli.rehearsal.scene import Moment, parse_moment
from obk_cli.runs.control_client import ask_status
from obk_cli.runs.protocol import StackStatus
from obk_cli.runs.registry import live_folders

__all__ = ["Launched"]

LEFT_S: Final = 7.0
"""How long nodes may take to follow their launcher: what their warden gives them, and more [s]."""
OVER_S: Final = 1.0
"""How long the last of its output may take after its end [s]."""
POLL_S: Final = 0.05
ANSWER_S: Final = 10.0
"""For an answer over the control socket, which is not judged by how soon it comes [s]."""


class Launched:
    """A launcher, from its start to its end."""

    def __init__(
        self, command: Sequence[str], environment: Mapping[str, str], parent: Path
    ) -> None:
        """Start a launcher.

        Args:
            command: `obk launch ... --format json`.
            environment: all of its variables.
            parent: the folder in which it makes its run's.
        """
        self._parent = parent
        self._changed = threading.Condition()
        self._moments: list[Moment] = []
        self._said: list[str] = []
        self._over_s: float | None = None
        self._run: Path | None = None
        self._child = BoundProcess(command, environment, on_line=self._hear, on_over=self._end)

    @property
    def moments(self) -> tuple[Moment, ...]:
        """What it has told so far."""
        with self._changed:
            return tuple(self._moments)

    @property
    def said(self) -> tuple[str, ...]:
        """The lines that it has said besides."""
        with self._changed:
            return tuple(self._said)

    @property
    def exit_code(self) -> int | None:
        """None: it runs."""
        return self._child.exit_code

    @property
    def over_s(self) -> float | None:
        """When its output ended [s since 1970]; None: not yet."""
        return self._over_s

    @property
    def run(self) -> Path | None:
        """The run's folder, once it is claimed."""
        if self._run is None:
            live = live_folders(self._parent)
            self._run = next((f for f, run in live.items() if run.pid == self._child.pid), None)
        return self._run

    def wait_until(
        self, holds: Callable[[tuple[Moment, ...]], bool], timeout_s: float, *, since: int = 0
    ) -> bool:
        """Wait for what it tells, at most so long, and not beyond its end; whether it came.

        Args:
            holds: asked of the moments after each new one.
            timeout_s: how long to wait.
            since: how many of the first moments not to ask of.
        """
        end = monotonic_s() + timeout_s
        with self._changed:
            while not (is_so := holds(tuple(self._moments[since:]))) and self._over_s is None:
                left_s = end - monotonic_s()
                if left_s <= 0 or not self._changed.wait(left_s):
                    break
            return is_so or holds(tuple(self._moments[since:]))

    def wait_for_end(self, timeout_s: float) -> int | None:
        """Wait for its end; gives the exit code, or None when it has not ended in time."""
        code = self._child.wait(timeout_s)
        if code is not None:
            with self._changed:
                self._changed.wait_for(lambda: self._over_s is not None, OVER_S)
        return code

    def outcome(self, timeout_s: float) -> int | None:
        """The exit code, waited for so long where it has said its last word; None: it runs."""
        # The kernel closes the output of a process some time before it tells of its end.
        return self.exit_code if self._over_s is None else self.wait_for_end(timeout_s)

    def status(self) -> StackStatus | None:
        """How it says that the stack is; None: no answer."""
        return None if self.run is None else ask_status(self.run, ANSWER_S)

    def end(self, timeout_s: float) -> int | None:
        """Ask for the end and wait; gives the exit code, None where it had to be killed."""
        if self.exit_code is None:
            self._child.signal(signal.SIGINT)
        code = self.wait_for_end(timeout_s)
        self._child.close()
        return code

    def clear_up(self) -> tuple[str, ...]:
        """End what has outlived the launcher, and give the commands of that."""
        if self._run is None:
            return ()
        end = monotonic_s() + LEFT_S
        while left := find_leftovers(self._parent, run=self._run.name):
            if monotonic_s() > end:
                end_leftovers(left)
                return tuple(process.command for process in left)
            self._pause()
        return ()

    def _pause(self) -> None:
        with self._changed:
            self._changed.wait(POLL_S)

    def _hear(self, line: str) -> None:
        moment = parse_moment(line)
        with self._changed:
            if moment is not None:
                self._moments.append(moment)
            elif not line.startswith("{"):
                self._said.append(line)
            self._changed.notify_all()

    def _end(self) -> None:
        with self._changed:
            self._over_s = wall_s()
            self._changed.notify_all()
