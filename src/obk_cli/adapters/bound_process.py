"""A program run as a child that does not outlive this process, heard line by line.

Takes a command, gives its lines and its exit code. It has a session of its own: Ctrl-C in this
terminal is for this process. When this process ends, whatever ends it, the child gets SIGTERM.
"""

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from obk_cli.adapters import bound_program

__all__ = ["BoundProcess"]

KILL_S: Final = 5.0
"""How long the kernel may take for a process that was killed [s]."""


class BoundProcess:
    """A child and its output."""

    def __init__(
        self,
        command: Sequence[str],
        environment: Mapping[str, str],
        *,
        on_line: Callable[[str], None],
        on_over: Callable[[], None],
    ) -> None:
        """Start a program; only from the main thread, with whose end it gets its signal.

        Args:
            command: the program and its arguments.
            environment: all of its variables.
            on_line: takes each line of its output and errors, from a thread.
            on_over: is told that there will be no more, from that thread.
        """
        binding = [sys.executable, "-I", "-S", str(Path(bound_program.__file__))]
        self._child = subprocess.Popen(
            [*binding, str(os.getpid()), *command],
            env=dict(environment),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
        )
        self._on_line = on_line
        self._on_over = on_over
        self._reader = threading.Thread(target=self._read, name="child", daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """The child's number."""
        return self._child.pid

    @property
    def exit_code(self) -> int | None:
        """Negative for the signal that ended it; None while it runs."""
        return self._child.poll()

    def wait(self, timeout_s: float) -> int | None:
        """Wait for its end; gives the exit code, or None when it has not ended in time."""
        try:
            return self._child.wait(max(0.0, timeout_s))
        except subprocess.TimeoutExpired:
            return None

    def signal(self, number: int) -> None:
        """Signal the child alone, if it is there."""
        self._child.send_signal(number)

    def close(self) -> None:
        """Kill the child where it still runs, and let go of its output."""
        self._child.kill()
        self.wait(KILL_S)
        # What the child started may hold the other end for a while longer.
        self._reader.join(KILL_S)

    def _read(self) -> None:
        assert self._child.stdout is not None
        with self._child.stdout as output:
            for line in output:
                self._on_line(line.rstrip("\n"))
        self._on_over()
