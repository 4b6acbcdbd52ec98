"""Identify processes by PID and start time, which differs when a PID is reused.

The start time comes from the kernel's clock since boot, which does not change when the time of day
is set. Source: proc(5), `/proc/<pid>/stat`.

The environment of every process of a stack, and of its children, contains the name of the run
folder (`OBK_RUN`) and the launcher's PID and start time (`OBK_LAUNCHER`).
"""

import os
import signal
import time
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

__all__ = [
    "LAUNCHER_MARK",
    "RUN_MARK",
    "boot_id",
    "is_process",
    "launch_marks",
    "seconds_since",
    "shares_pid_namespace",
    "signal_process",
    "since_boot_s",
    "start_s",
    "this_process",
    "wait_for_ends",
    "working_folder",
]

SAME_S: Final = 0.005
"""Half a tick of the kernel's clock [s]."""
POLL_S: Final = 0.02
RUN_MARK: Final = "OBK_RUN"
LAUNCHER_MARK: Final = "OBK_LAUNCHER"
UNRECORDED: Final = "unrecorded"
"""Replaces a run folder's name if no folder could be created."""
_STATE: Final = 0
_START_TICKS: Final = 19
"""Field index after the command's name, which is in parentheses and may contain anything."""


def start_s(pid: int) -> float | None:
    """When a process started [s since boot]; None for a zombie or if it does not exist."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_bytes()
    except OSError:
        return None
    fields = stat.rpartition(b")")[2].split()
    is_gone = fields[_STATE] in (b"Z", b"X")
    return None if is_gone else int(fields[_START_TICKS]) / os.sysconf("SC_CLK_TCK")


def is_process(pid: int, started: float) -> bool:
    """Whether the process with this PID and start time [s since boot] is running."""
    start = start_s(pid)
    return start is not None and abs(start - started) < SAME_S


def signal_process(pid: int, started: float, number: int) -> None:
    """Signal a process if it is running, but never another one that reuses its PID."""
    with suppress(OSError):
        descriptor = os.pidfd_open(pid)
        try:
            if is_process(pid, started):
                signal.pidfd_send_signal(descriptor, number)
        finally:
            os.close(descriptor)


def since_boot_s() -> float:
    """The current time [s since boot]."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def seconds_since(started: float) -> float:
    """Time since a process's start, which is given in seconds since boot [s]."""
    return since_boot_s() - started


def wait_for_ends(
    processes: Collection[tuple[int, float]], timeout_s: float
) -> list[tuple[int, float]]:
    """Wait until processes (PID and start time) have ended; return those still running."""
    end = time.monotonic() + timeout_s
    while left := [process for process in processes if is_process(*process)]:
        if time.monotonic() > end:
            break
        time.sleep(POLL_S)
    return left


def this_process() -> tuple[int, float]:
    """This process's PID and start time [s since boot], as recorded for a run."""
    pid = os.getpid()
    start = start_s(pid)
    assert start is not None, "a running process is in /proc"
    return pid, start


def launch_marks(run_folder: Path | None) -> Mapping[str, str]:
    """The environment variables that mark the processes of this launcher.

    Args:
        run_folder: the folder of the run; None if it could not be created.
    """
    pid, started = this_process()
    name = run_folder.name if run_folder else UNRECORDED
    return {RUN_MARK: name, LAUNCHER_MARK: f"{pid}:{started}"}


def working_folder(pid: int) -> Path | None:
    """The working directory of a process; None if this user has no such process."""
    try:
        return Path(f"/proc/{pid}/cwd").readlink()
    except OSError:
        return None


def shares_pid_namespace(pid: int) -> bool:
    """Whether a process of this user shares our PID namespace.

    A process in a container does not: process ids there differ from those here.
    Source: pid_namespaces(7).
    """
    try:
        return Path(f"/proc/{pid}/ns/pid").readlink() == Path("/proc/self/ns/pid").readlink()
    except OSError:
        return False


def boot_id() -> str:
    """The unique id of this boot of the machine."""
    return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
