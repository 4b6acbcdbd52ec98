"""Before faults are injected: reject hardware and running stacks, and create a run folder."""

import shutil
from pathlib import Path
from typing import Final

from obk_cli.clock import local_time
from obk_cli.config.model import Stack
from obk_cli.errors import CommandFailedError
from obk_cli.runs.folder import make_run_folder, run_folders
from obk_cli.runs.registry import live_folders

__all__ = ["make_rehearsal_folder", "refuse_hardware", "refuse_running"]


def refuse_hardware(stack: Stack) -> None:
    """Reject a stack with a robot that is not simulated.

    Raises:
        CommandFailedError: it has a robot that is hardware.
    """
    robot = next((robot for robot in stack.section("robot") if not robot.runs_simulation), None)
    if robot is None:
        return
    span = robot.is_simulated.span if robot.is_simulated else robot.span
    raise CommandFailedError(
        f"{span.path}:{span.line}:{span.column}: the robot {robot.full_name} is hardware, and a "
        "rehearsal kills and freezes the nodes that control it",
        help="`is_simulated: true` and a `sim` block, in the config or by `--set`, simulate it",
    )


def refuse_running(runs: Path, name: str) -> None:
    """Reject a stack that is already running on this host, in any ROS domain.

    Args:
        runs: the folder of all runs.
        name: the config's.

    Raises:
        CommandFailedError: it is running.
    """
    other = next((run for run in live_folders(runs).values() if run.name == name), None)
    if other is not None:
        raise CommandFailedError(
            f"the stack `{name}` is running in ROS domain {other.domain} (process {other.pid}), "
            "and a rehearsal at the same time would disturb both",
            help=f"`obk stop {name}` stops it",
        )


KEPT: Final = 10
"""Rehearsals whose logs are kept."""


def make_rehearsal_folder(parent: Path, name: str) -> Path:
    """Create the folder of a new rehearsal, and remove the oldest ones.

    Rehearsals have a folder of their own, so that they never displace the logs of other runs.

    Args:
        parent: the folder of all rehearsals.
        name: the config's.

    Raises:
        CommandFailedError: it cannot be created.
    """
    try:
        home = make_run_folder(parent, name, local_time())
    except OSError as error:
        raise CommandFailedError(
            f"cannot create the folder for the logs of a rehearsal: {error}"
        ) from error
    for old in run_folders(parent)[KEPT:]:
        if not live_folders(old / "runs"):
            shutil.rmtree(old, ignore_errors=True)
    return home
