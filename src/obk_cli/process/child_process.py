"""Run a program as a child that does not outlive this process, and read its output by line.

The child has its own session, so Ctrl-C in this terminal reaches only this process. When this
process ends, for any reason, the child receives SIGTERM.

As a program (`python -I -S child_process.py PARENT PROGRAM ARGUMENTS...`) this module binds itself
to PARENT and becomes PROGRAM, because a process with threads cannot do so between fork and exec. It
imports the standard library only, so that it starts at once.
Source: prctl(2), PR_SET_PDEATHSIG.
"""

import ctypes
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from time import monotonic
from typing import Final

__all__ = ["BoundChild", "run_in_foreground"]

KILL_S: Final = 5.0
"""Limit for a killed process to exit [s]."""
_REPEATED_S: Final = 0.5
"""Signals this close together are one: a process and its group often receive the same one [s]."""


class BoundChild:
    """A child and its output."""

    def __init__(
        self,
        command: Sequence[str],
        environment: Mapping[str, str],
        *,
        on_line: Callable[[str], None],
        on_output_end: Callable[[], None],
    ) -> None:
        """Start a program; only from the main thread, whose exit triggers the signal.

        Args:
            command: the program and its arguments.
            environment: its complete environment.
            on_line: receives each line of its stdout and stderr, from a thread.
            on_output_end: called when its output has ended, from that thread.
        """
        self._child = subprocess.Popen(
            [*_binding(), *command],
            env=dict(environment),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
        )
        self._on_line = on_line
        self._on_output_end = on_output_end
        self._reader = threading.Thread(target=self._read, name="child", daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """The child's process id."""
        return self._child.pid

    @property
    def exit_code(self) -> int | None:
        """Negative for the signal that killed it; None while it is running."""
        return self._child.poll()

    def wait(self, timeout_s: float) -> int | None:
        """Wait for it to exit; return the exit code, or None if it has not ended in time."""
        try:
            return self._child.wait(max(0.0, timeout_s))
        except subprocess.TimeoutExpired:
            return None

    def signal(self, number: int) -> None:
        """Signal the child alone, if it is running."""
        self._child.send_signal(number)

    def close(self) -> None:
        """Kill the child if it is still running, and close its output."""
        self._child.kill()
        self.wait(KILL_S)
        # Descendants may keep the other end open for a while.
        self._reader.join(KILL_S)

    def _read(self) -> None:
        assert self._child.stdout is not None
        with self._child.stdout as output:
            for line in output:
                self._on_line(line.rstrip("\n"))
        self._on_output_end()


def _binding() -> list[str]:
    return [sys.executable, "-I", "-S", str(Path(__file__)), str(os.getpid())]


def run_in_foreground(
    command: Sequence[str], environment: Mapping[str, str], *, releases_interrupts: bool = False
) -> int | None:
    """Run a program in this terminal until it ends.

    Ctrl-C and other signals that terminate this process interrupt the program; a second one kills
    it.

    Args:
        command: the program and its arguments.
        environment: its complete environment.
        releases_interrupts: whether the program calls `release_interrupts` when it can handle
            Ctrl-C; until then it is held back.

    Returns:
        Its exit code, negative for the signal that killed it; None if it was interrupted.
    """
    from obk_cli.process.signals import (
        handle_end_signals,
        hold_interrupts,
        release_interrupts,
    )

    received_s: list[float] = []

    def end(number: signal.Signals) -> None:
        received_s.append(monotonic())
        if received_s[-1] - received_s[0] > _REPEATED_S:
            child.kill()
        elif len(received_s) == 1 and (number != signal.SIGINT or not sys.stdin.isatty()):
            child.send_signal(signal.SIGINT)  # the terminal also sends Ctrl-C to the program

    bound = [*_binding(), *command]
    if releases_interrupts:
        hold_interrupts()
    try:
        with subprocess.Popen(bound, env=dict(environment)) as child, handle_end_signals(end):
            release_interrupts()
            exit_code = child.wait()
    finally:
        release_interrupts()
    return None if received_s else exit_code


PR_SET_PDEATHSIG = 1


def main(parent: int, *command: str) -> None:
    """Become the program of a command; exit at once if the parent has ended."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        sys.exit(1)
    os.execvp(command[0], command)  # noqa: S606 - deliberately without a shell


if __name__ == "__main__":
    main(int(sys.argv[1]), *sys.argv[2:])
