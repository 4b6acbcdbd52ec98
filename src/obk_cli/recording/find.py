"""Which recording a user means: a file, or the one of a run."""

import os
from pathlib import Path
from typing import Final

from obelisk_spec.suggestions import did_you_mean
from obk_cli.errors import CommandFailedError
from obk_cli.launch.runs import config_of, run_folders

__all__ = ["RECORDING", "recording_meant"]

RECORDING: Final = "recording.mcap"
"""The file in a run's folder."""


def recording_meant(parent: Path, name: str | None) -> Path:
    """The path of a recording.

    Args:
        parent: the folder of all runs.
        name: a file, a folder with one recording, the name of a config (its newest run that was
            recorded) or of a run's folder; None: the newest run that was recorded.

    Raises:
        CommandFailedError: there is none of that name.
    """
    if name is not None and os.path.isfile(name):  # noqa: PTH113  (`Path.is_file` raises)
        return Path(name)
    if name is not None and (inside := _in_folder(Path(name))):
        return inside
    folders = run_folders(parent)
    fitting = [f for f in folders if name is None or name in (f.name, config_of(f))]
    recorded = [f / RECORDING for f in fitting if (f / RECORDING).is_file()]
    if recorded:
        return recorded[0]
    how = "record one with `obk launch --record`, or `obk record` while it runs"
    if name is None:
        raise CommandFailedError(f"no run in {parent} was recorded", help=how)
    if fitting:
        raise CommandFailedError(f"the run `{name}` was not recorded", help=how)
    names = dict.fromkeys(config_of(folder) for folder in folders)
    raise CommandFailedError(
        f"there is no file and no run called `{name}`", help=did_you_mean(name, names) or how
    )


def _in_folder(folder: Path) -> Path | None:
    """The recording in a folder, such as rosbag2 makes, where it has exactly one."""
    is_there = os.path.isdir(folder)  # noqa: PTH112  (`Path.is_dir` raises)
    files = sorted(folder.glob("*.mcap")) if is_there else []
    return files[0] if len(files) == 1 else None
