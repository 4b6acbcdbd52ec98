"""Runs whose launcher is alive, and the claim of a new one: no two with the same nodes at once."""

import fcntl
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Final

import psutil

from obk_cli.errors import CommandFailedError
from obk_cli.launch.runs import Run, make_run_folder, read_run, read_runs, run_folders, write_run

__all__ = ["KEPT_RUNS", "claim_run", "is_alive", "live_runs", "this_process"]

KEPT_RUNS: Final = 50
CLAIM_S: Final = 5.0
"""How long another claim may take [s]."""
POLL_S: Final = 0.01


def this_process() -> tuple[int, float]:
    """This process's id and start, as a run tells them."""
    this = psutil.Process()
    return this.pid, this.create_time()


def is_alive(run: Run) -> bool:
    """Whether the run's launcher is there and has not brought the run to its end."""
    if run.ended is not None:
        return False
    try:
        launcher = psutil.Process(run.pid)
        is_same = abs(launcher.create_time() - run.started) < 1.0
        return is_same and launcher.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def live_runs(parent: Path) -> tuple[Run, ...]:
    """The runs of this machine's launchers that are alive, in every ROS domain."""
    return tuple(run for run in read_runs(parent) if is_alive(run))


def claim_run(parent: Path, run: Run, now: datetime) -> Path:
    """Make the folder of a new run and say there what runs; remove the oldest ones.

    Of two at the same moment one comes first, and the other one sees it.

    Raises:
        CommandFailedError: a live run of the same ROS domain has the name or one of the nodes.
        OSError: the folder cannot be written.
    """
    parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    with _turn(parent / f".domain_{run.domain}.lock"):
        for other in live_runs(parent):
            _refuse_clash(run, other)
        folder = make_run_folder(parent, run.name, now)
        write_run(folder, run)
    for old in run_folders(parent)[KEPT_RUNS:]:
        told = read_run(old)
        if told is None or not is_alive(told):
            shutil.rmtree(old, ignore_errors=True)
    return folder


def _refuse_clash(run: Run, other: Run) -> None:
    common = sorted(set(run.all_nodes) & set(other.all_nodes))
    if other.domain == run.domain and (other.name == run.name or common):
        nodes = ", ".join(common or other.all_nodes)
        raise CommandFailedError(
            f"the stack '{other.name}' already runs in the ROS domain {other.domain} "
            f"(process {other.pid}, {nodes})",
            help="stop it or use another ROS_DOMAIN_ID",
        )


@contextmanager
def _turn(path: Path) -> Iterator[None]:
    """Wait for a file's lock, with a deadline; it is free again at the end, however that comes."""
    deadline = time.monotonic() + CLAIM_S
    with path.open("w") as file:
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise CommandFailedError(
                        f"another process has held {path} for {CLAIM_S:g} s",
                        help="end an `obk launch` that is stopped or hangs",
                    ) from None
                time.sleep(POLL_S)
        yield
