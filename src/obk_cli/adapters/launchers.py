"""The end of another launcher on this host, when it is asked for."""

import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, Literal

from obk_cli.adapters.control_client import ask_stop
from obk_cli.adapters.leftovers import end_leftovers, find_leftovers
from obk_cli.adapters.live_runs import is_alive
from obk_cli.launch.runs import Run, read_run
from obk_cli.process.identity import signal_process, wait_for_ends

__all__ = ["STOP_S", "LauncherEnd", "end_launcher"]

LauncherEnd = Literal["ended", "killed", "still there"]
STOP_S: Final = 15.0
"""How long a stack's way down may take before it counts as stuck [s]."""
KILL_S: Final = 5.0
"""How long the kernel may take for a process that was killed [s]."""
EXIT_S: Final = 2.0
"""How long a launcher's process may take to go once its run is over [s]."""
WARDEN_S: Final = 2.0
"""How long the nodes of a killed launcher may take to follow it [s]."""
POLL_S: Final = 0.02


def end_launcher(
    folder: Path, run: Run, *, reason: str, timeout_s: float = STOP_S, may_kill: bool = False
) -> LauncherEnd:
    """Ask a launcher to bring its stack down, and wait for its end.

    Asks over the control socket, else by SIGINT; one that was stopped goes on for that.

    Args:
        folder: the run's.
        run: whose launcher.
        reason: what the launcher tells its user.
        timeout_s: for the answer and the way down [s].
        may_kill: after that, kill the launcher, and what it leaves.
    """

    def is_there() -> bool:
        return is_alive(read_run(folder) or run)

    # One that was stopped (Ctrl-Z) has to go on to end anything.
    signal_process(run.pid, run.started, signal.SIGCONT)
    end = time.monotonic() + timeout_s
    # Not sooner: one that is slow to answer would take the signal for impatience, and hurry.
    if not ask_stop(folder, reason, timeout_s / 2):
        signal_process(run.pid, run.started, signal.SIGINT)
    if _comes_true(lambda: not is_there(), end - time.monotonic()):
        # The run is over; a launcher that is a program of its own is about to go, too.
        wait_for_ends([(run.pid, run.started)], EXIT_S)
        return "ended"
    if not may_kill:
        return "still there"
    signal_process(run.pid, run.started, signal.SIGKILL)
    if not _comes_true(lambda: not is_there(), KILL_S):
        return "still there"
    parent = folder.parent
    _comes_true(lambda: not find_leftovers(parent, run=folder.name), WARDEN_S)
    end_leftovers(find_leftovers(parent, run=folder.name))
    return "killed"


def _comes_true(condition: Callable[[], bool], timeout_s: float) -> bool:
    end = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(POLL_S)
    return True
