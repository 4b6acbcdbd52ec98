"""The lock of a run: a node name is used by only one run at a time on this machine.

A run's folder is created under a file lock of its ROS domain before anything starts. When the run
is over, the folder records how it ended.
"""

import errno
import fcntl
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final

from obelisk_recordings.find import RECORDING
from obk_cli.clock import local_time, wall_s
from obk_cli.emit.json import emit_plan
from obk_cli.errors import CommandFailedError, ObkError
from obk_cli.files import explain_os_error, is_within_untrusted
from obk_cli.launch.events import Ended
from obk_cli.launch.options import KEPT_RUNS, LaunchOptions
from obk_cli.optional_deps import run_versions
from obk_cli.plan.plan import Plan
from obk_cli.process.identity import boot_id, this_process
from obk_cli.ros.environment import RosEnvironment
from obk_cli.runs.folder import (
    WRITABLE_HOME,
    Run,
    RunOrigin,
    make_run_folder,
    read_run,
    record_end,
    run_folders,
    runs_folder,
    write_run,
)
from obk_cli.runs.registry import STOP_S, end_launcher, is_alive, live_folders

if TYPE_CHECKING:
    from obk_cli.launch.console import Output

__all__ = ["claim_run", "locked_run"]

CLAIM_S: Final = 5.0
"""Limit for another launch to hold the lock [s]."""
MOST_REPLACED: Final = 20
"""Maximum number of launchers to stop; if there are more, something keeps restarting them."""
POLL_S: Final = 0.01


@dataclass(slots=True, kw_only=True)
class RunLock:
    """A run's node names on this machine, and its folder."""

    run: Run
    folder: Path | None
    fault: str = ""
    """Why the run has no folder; empty if it has one."""
    ended: Ended | None = None

    def report(self, output: "Output") -> None:
        """Report where the logs are, or why no logs are written."""
        if self.fault:
            output.note(
                f"warning: {self.fault}: no logs are kept, and `obk ps`, `stop` and `logs` cannot "
                f"find this run; {WRITABLE_HOME}"
            )
        else:
            output.note(f"{self.run.name}: logs in {self.folder}")


@contextmanager
def locked_run(
    plan: Plan, environment: RosEnvironment, options: LaunchOptions
) -> Iterator[RunLock]:
    """Inside the `with` block, this launch owns its node names on this machine.

    Raises:
        CommandFailedError: the stack or one of its nodes is already running, or nothing can be
            recorded because the run has no folder.
    """
    run = _run(plan, environment, options)
    parent, folder, fault = runs_folder(environment.variables), None, ""
    try:
        folder = claim_run(
            parent,
            run,
            local_time(),
            made_from=RunOrigin(plan=emit_plan(plan), versions=run_versions()),
            keep=options.kept_runs,
            replace_other=options.replaces,
        )
    except OSError as error:
        fault = f"the run folder cannot be created in {parent} ({explain_os_error(error)})"
        if options.recording is not None:
            message = f"nothing can be recorded: {fault}"
            raise CommandFailedError(message, help=WRITABLE_HOME) from error
    lock = RunLock(run=run, folder=folder, fault=fault)
    if folder is None:
        yield lock
        return
    try:
        yield lock
    except ObkError as error:
        lock.ended = Ended(exit_code=error.exit_code, cause=error.message)
        raise
    finally:
        # If this cannot be written, the exit of the process shows that the run is over.
        with suppress(OSError):
            ended = lock.ended
            exit_code, cause = (ended.exit_code, ended.cause) if ended else (None, "")
            record_end(folder, run, wall_s(), exit_code, cause)


def _run(plan: Plan, environment: RosEnvironment, options: LaunchOptions) -> Run:
    pid, started = this_process()
    devices = options.share.devices
    tiers = [[p for p in tier if p.device in devices] for tier in plan.tiers]
    return Run(
        name=plan.name,
        pid=pid,
        started=started,
        domain=environment.domain,
        config=options.config,
        nodes=tuple(p.full_name for tier in tiers for p in tier if p.has_lifecycle),
        other_nodes=tuple(p.full_name for tier in tiers for p in tier if not p.has_lifecycle),
        devices=tuple(sorted(devices)) if options.share.is_part else (),
        leads=options.share.leads,
    )


def claim_run(
    parent: Path,
    run: Run,
    now: datetime,
    *,
    made_from: RunOrigin | None = None,
    keep: int = KEPT_RUNS,
    replace_other: bool = False,
) -> Path:
    """Create and describe the folder of a new run; remove the oldest folders.

    If two launches start together, the first gets the lock and the second finds its run. Launches
    of one config in one ROS domain do not conflict if each runs a different device of it.

    Args:
        parent: the folder of all runs.
        run: the new run.
        now: the time in the user's time zone.
        made_from: the sources of the run.
        keep: how many runs to keep, including this one; running ones are always kept.
        replace_other: stop conflicting launches.

    Raises:
        CommandFailedError: a running stack in the same ROS domain has the name or a node name.
        OSError: the folder cannot be written, or belongs to another user.
    """
    if is_within_untrusted(parent):
        raise PermissionError(errno.EPERM, "it belongs to another user", str(parent))
    parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    claimed = replace(run, boot=boot_id())
    for _ in range(MOST_REPLACED):
        with _file_lock(parent / f".domain_{run.domain}.lock"):
            conflicting = _first_conflicting(parent, run)
            if conflicting is None:
                folder = _described_folder(parent, claimed, now, made_from)
        # The rest may take longer than other launches wait for the lock.
        if conflicting is None:
            _remove_old(parent, keep)
            return folder
        if not replace_other:
            raise _refusal(run, conflicting[1])
        _end_launcher(*conflicting)
    raise CommandFailedError(f"another process keeps restarting the stack `{run.name}`")


def _described_folder(parent: Path, run: Run, now: datetime, made_from: RunOrigin | None) -> Path:
    """Create a run's folder with its description; removed again if that cannot be written.

    Raises:
        OSError: the description cannot be written.
    """
    folder = make_run_folder(parent, run.name, now)
    try:
        write_run(folder, run, made_from)
    except OSError:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return folder


def _first_conflicting(parent: Path, run: Run) -> tuple[Path, Run] | None:
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
        f"the stack `{other.name}` is already running in ROS domain {other.domain} "
        f"(process {other.pid}, {nodes})",
        help="stop it or use another ROS_DOMAIN_ID",
    )


def _end_launcher(folder: Path, other: Run) -> None:
    end = end_launcher(folder, other, reason="replaced", timeout_s=STOP_S, may_kill=True)
    if end == "running":
        raise CommandFailedError(
            f"the stack `{other.name}` in ROS domain {other.domain} did not stop "
            f"(process {other.pid})",
            help="the process cannot be killed; use another ROS_DOMAIN_ID",
        )


def _remove_old(parent: Path, keep: int) -> None:
    """Remove all but the latest runs; those with a recording stay and do not count."""
    without = [one for one in run_folders(parent) if not (one / RECORDING).exists()]
    for old in without[max(keep, 1) :]:
        run = read_run(old)
        if run is None or not is_alive(run):
            shutil.rmtree(old, ignore_errors=True)


@contextmanager
def _file_lock(path: Path) -> Iterator[None]:
    """Wait for a file's lock, up to a limit; the lock is always released on exit."""
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
                        help="stop any `obk launch` that is suspended or hangs",
                    ) from None
                time.sleep(POLL_S)
        yield
