"""Runs whose launcher is alive, and how to end one."""

import signal
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, Literal

from obk_cli.files import is_planted, is_within_planted
from obk_cli.process.identity import boot_id, is_process, signal_process, wait_for_ends
from obk_cli.runs.control_client import ask_stop
from obk_cli.runs.folder import Run, read_run, run_folders
from obk_cli.runs.orphans import end_leftovers, find_leftovers

__all__ = ["STOP_S", "LauncherEnd", "end_launcher", "is_alive", "live_folders", "live_runs"]

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


def is_alive(run: Run) -> bool:
    """Whether the run's launcher is there and has not brought the run to its end."""
    if run.ended is not None or run.boot not in ("", boot_id()):
        return False
    return is_process(run.pid, run.started)


def live_folders(parent: Path) -> Mapping[Path, Run]:
    """Folder -> run of this user's launchers that are alive, newest first, in all domains."""
    if is_within_planted(parent):
        return {}
    own = (folder for folder in run_folders(parent) if not is_planted(folder))
    told = ((folder, read_run(folder)) for folder in own)
    return {folder: run for folder, run in told if run is not None and is_alive(run)}


def live_runs(parent: Path) -> tuple[Run, ...]:
    """The runs of this machine's launchers that are alive, in every ROS domain."""
    return tuple(live_folders(parent).values())


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
