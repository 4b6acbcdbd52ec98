"""Runs whose launcher is alive."""

from collections.abc import Mapping
from pathlib import Path

from obk_cli.files import is_planted, is_within_planted
from obk_cli.launch.runs import Run, read_run, run_folders
from obk_cli.process.identity import boot_id, is_process

__all__ = ["is_alive", "live_folders", "live_runs"]


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
