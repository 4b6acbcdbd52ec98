"""Find and terminate orphans: processes of stacks whose launcher has ended.

They are recognized by the marks in their environment (`launch_marks`). Processes of other users are
ignored.
"""

import os
import signal
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import psutil

from obk_cli.process.identity import (
    LAUNCHER_MARK,
    RUN_MARK,
    is_process,
    shares_pid_namespace,
    signal_process,
    start_s,
    wait_for_ends,
)
from obk_cli.runs.folder import read_run

__all__ = ["Orphan", "end_orphans", "find_orphans"]

GRACE_S: Final = 2.0
"""Time between SIGTERM and SIGKILL [s]."""
KILL_S: Final = 5.0
"""Limit for a killed process to exit [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Orphan:
    """A process that should have ended with its launcher."""

    pid: int
    started: float
    """[s since boot]"""
    run: str
    """The name of its run's folder."""
    command: str


def find_orphans(parent: Path, run: str | None = None) -> tuple[Orphan, ...]:
    """This user's processes whose launcher has ended, by PID.

    Args:
        parent: the folder of all runs.
        run: only processes of the run whose folder has this name; None: all.
    """
    ancestors = _own_ancestors()
    found = (
        _orphan(process, parent) for process in _own_processes() if process.pid not in ancestors
    )
    every = (orphan for orphan in found if orphan is not None)
    selected = (orphan for orphan in every if run in (None, orphan.run))
    return tuple(sorted(selected, key=lambda orphan: orphan.pid))


def end_orphans(orphans: Iterable[Orphan]) -> tuple[Orphan, ...]:
    """Terminate processes, their groups and descendants: SIGTERM, a grace period, SIGKILL.

    Returns:
        The orphans that are still running.
    """
    every = tuple(orphans)
    targets = _with_descendants(every)
    for target in targets:
        signal_process(*target, signal.SIGTERM)
    # Processes started in the meantime belong to them.
    survivors = {*wait_for_ends(targets, GRACE_S), *_with_descendants(every)}
    for target in survivors:
        signal_process(*target, signal.SIGKILL)
    wait_for_ends(survivors, KILL_S)
    return tuple(orphan for orphan in every if is_process(orphan.pid, orphan.started))


def _orphan(process: psutil.Process, parent: Path) -> Orphan | None:
    """The process as an orphan; None if it is not one."""
    try:
        variables = process.environ()
        if RUN_MARK not in variables or not shares_pid_namespace(process.pid):
            return None
        if not _is_launcher_gone(variables, parent):
            return None
        started = start_s(process.pid)
        command = " ".join(process.cmdline()) or process.name()
    except psutil.Error:  # ended in the meantime
        return None
    if started is None:
        return None
    return Orphan(pid=process.pid, started=started, run=variables[RUN_MARK], command=command)


def _is_launcher_gone(variables: Mapping[str, str], parent: Path) -> bool:
    """Whether the launcher is known to have ended; False if in doubt."""
    number, _, start = variables.get(LAUNCHER_MARK, "").partition(":")
    try:
        return not is_process(int(number), float(start))
    except ValueError:
        run = read_run(parent / variables[RUN_MARK])
    return run is not None and not is_process(run.pid, run.started)


def _own_processes() -> Iterable[psutil.Process]:
    this_user = os.getuid()
    for process in psutil.process_iter():
        with suppress(psutil.Error):
            if process.uids().real == this_user:
                yield process


def _own_ancestors() -> set[int]:
    """This process and its ancestors, which are never terminated."""
    this = psutil.Process()
    return {this.pid, *(parent.pid for parent in this.parents())}


def _with_descendants(orphans: Iterable[Orphan]) -> set[tuple[int, float]]:
    """The processes, their descendants and the groups that they lead."""
    roots = {orphan.pid for orphan in orphans if is_process(orphan.pid, orphan.started)}
    pids = {process.pid for process in _own_processes() if _group_of(process.pid) in roots}
    for root in roots:
        with suppress(psutil.Error):
            pids.update(child.pid for child in psutil.Process(root).children(recursive=True))
    descendants = (roots | pids) - _own_ancestors()
    starts = ((pid, start_s(pid)) for pid in descendants)
    return {(pid, started) for pid, started in starts if started is not None}


def _group_of(pid: int) -> int | None:
    try:
        return os.getpgid(pid)
    except OSError:
        return None
