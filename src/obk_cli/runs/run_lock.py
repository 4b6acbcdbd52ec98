"""The claim of a new run: no two with the same nodes at once."""

import errno
import fcntl
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Final

from obk_cli.adapters.planted import is_within_planted
from obk_cli.adapters.process_start import boot_id
from obk_cli.errors import CommandFailedError
from obk_cli.runs.folder import MadeFrom, Run, make_run_folder, read_run, run_folders, write_run
from obk_cli.runs.registry import STOP_S, end_launcher, is_alive, live_folders

__all__ = ["KEPT_RUNS", "claim_run"]

KEPT_RUNS: Final = 50
CLAIM_S: Final = 5.0
"""How long another claim may take [s]."""
MOST_REPLACED: Final = 20
"""Launchers in the way, after which whoever starts them again has won."""
POLL_S: Final = 0.01


def claim_run(
    parent: Path,
    run: Run,
    now: datetime,
    *,
    made_from: MadeFrom | None = None,
    keep: int = KEPT_RUNS,
    replace_other: bool = False,
) -> Path:
    """Make the folder of a new run and say there what runs; remove the oldest ones.

    Of two at the same moment one comes first, and the other one sees it. Launchers of one config
    that each run another device of it, in one ROS domain, are no obstacle to one another.

    Args:
        parent: the folder of all runs.
        run: what runs.
        now: the time in the user's time zone.
        made_from: what it was made from.
        keep: how many runs stay, this one included; live ones always do.
        replace_other: end whoever is in the way.

    Raises:
        CommandFailedError: a live run of the same ROS domain has the name or one of the nodes.
        OSError: the folder cannot be written, or is another user's.
    """
    if is_within_planted(parent):
        raise PermissionError(errno.EPERM, "it is another user's", str(parent))
    parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    claimed = replace(run, boot=boot_id())
    for _ in range(MOST_REPLACED):
        with _turn(parent / f".domain_{run.domain}.lock"):
            in_the_way = _first_in_the_way(parent, run)
            if in_the_way is None:
                folder = _told_folder(parent, claimed, now, made_from)
        # The rest may take longer than others wait for the lock.
        if in_the_way is None:
            _remove_old(parent, keep)
            return folder
        if not replace_other:
            raise _refusal(run, in_the_way[1])
        _end(*in_the_way)
    raise CommandFailedError(f"the stack `{run.name}` is started again and again from elsewhere")


def _told_folder(parent: Path, run: Run, now: datetime, made_from: MadeFrom | None) -> Path:
    """The folder of a run that says what runs; none is left where it cannot say so.

    Raises:
        OSError: it cannot be written.
    """
    folder = make_run_folder(parent, run.name, now)
    try:
        write_run(folder, run, made_from)
    except OSError:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return folder


def _first_in_the_way(parent: Path, run: Run) -> tuple[Path, Run] | None:
    others = live_folders(parent).items()
    return next(((folder, other) for folder, other in others if _clash(run, other)), None)


def _clash(run: Run, other: Run) -> bool:
    if other.domain != run.domain:
        return False
    is_same_part = not (run.devices and other.devices) or set(run.devices) & set(other.devices)
    return bool(_common(run, other) or (other.name == run.name and is_same_part))


def _common(run: Run, other: Run) -> list[str]:
    return sorted(set(run.all_nodes) & set(other.all_nodes))


def _refusal(run: Run, other: Run) -> CommandFailedError:
    nodes = ", ".join(_common(run, other) or other.all_nodes)
    return CommandFailedError(
        f"the stack `{other.name}` already runs in the ROS domain {other.domain} "
        f"(process {other.pid}, {nodes})",
        help="stop it or use another ROS_DOMAIN_ID",
    )


def _end(folder: Path, other: Run) -> None:
    end = end_launcher(folder, other, reason="replaced", timeout_s=STOP_S, may_kill=True)
    if end == "still there":
        raise CommandFailedError(
            f"the stack `{other.name}` in the ROS domain {other.domain} does not end "
            f"(process {other.pid})",
            help="the system holds on to that process; use another ROS_DOMAIN_ID",
        )


def _remove_old(parent: Path, keep: int) -> None:
    for old in run_folders(parent)[max(keep, 1) :]:
        told = read_run(old)
        if told is None or not is_alive(told):
            shutil.rmtree(old, ignore_errors=True)


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
