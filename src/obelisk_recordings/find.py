"""Find a recording by a file, a folder, or the name of a run, without importing libraries.

A launch keeps its recording in the folder of its run, `<config>_<date>_<time>`.
"""

import os
import re
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Final

from obelisk_recordings.bag import RecordingError
from obelisk_spec.suggestions import did_you_mean, with_number

__all__ = [
    "RECORDING",
    "config_of",
    "find_recording",
    "folder_of_runs",
    "name_and_place",
    "run_folders",
    "run_name",
]

_FOLDER_NAME: Final = re.compile(r"(?P<config>.+)_(?P<stamp>\d{8}_\d{6})(?:_(?P<suffix>\d+))?")
RECORDING: Final = "recording.mcap"
"""Name of the recording in a run's folder."""
_LONGEST_NAME: Final = 200
"""Maximum length of a config's name in that of a folder [bytes]."""
_EARLIER: Final = re.compile(r"(?P<name>.+)~(?P<place>[0-9]{1,4})")
"""`arm~1` is the run before the most recent one."""


def run_name(config: str, start: datetime) -> str:
    """Return the name of a run's folder, without the suffix that is added if the name is taken.

    Very long names are cut, because the length of file names is limited.
    """
    short = config.replace("/", "_").encode()[:_LONGEST_NAME].decode(errors="ignore")
    return f"{short}_{start:%Y%m%d_%H%M%S}"


def folder_of_runs(environment: Mapping[str, str]) -> Path | None:
    """Return the folder of all runs: under OBK_HOME, ROS_LOG_DIR, or the user's state folder.

    None if there is no such folder because the user has no home directory.
    """
    home = environment.get("OBK_HOME")
    logs = environment.get("ROS_LOG_DIR")
    if home:
        return Path(home) / "runs"
    if logs:
        return Path(logs) / "obk" / "runs"

    from platformdirs import user_state_path  # only if no variable sets the folder

    try:
        return user_state_path("obk") / "runs"
    except RuntimeError:
        return None


def run_folders(parent: Path) -> tuple[Path, ...]:
    """Return the folders of all runs, newest first; folders with other names are ignored.

    If the user cannot read `parent`, the result is empty.
    """
    try:
        found = list(parent.glob("*/"))
    except PermissionError:
        return ()
    named = ((path, _FOLDER_NAME.fullmatch(path.name)) for path in found)
    dated = [(m["stamp"], int(m["suffix"] or 0), path) for path, m in named if m]
    return tuple(path for _, _, path in sorted(dated, reverse=True))


def config_of(folder: Path) -> str:
    """Return the part of a run folder's name that names the config, with `_` in place of `/`."""
    match = _FOLDER_NAME.fullmatch(folder.name)
    return match["config"] if match else folder.name


def name_and_place(name: str) -> tuple[str, int]:
    """Split `arm~1` into the name and how many runs before the most recent one are meant."""
    earlier = _EARLIER.fullmatch(name)
    return (earlier["name"], int(earlier["place"])) if earlier else (name, 0)


def find_recording(parent: Path | None, name: str | None) -> Path:
    """Find the recording that a name refers to.

    Args:
        parent: the folder of all runs; None if there is none.
        name: a file, a folder with one recording, the name of a config (its most recent recorded
            run; with the suffix `~1`, the one before) or of a run's folder; None for the most
            recent recorded run.

    Raises:
        RecordingError: no recording has this name.
    """
    if name is not None and os.path.isfile(name):  # noqa: PTH113  (`Path.is_file` raises)
        return Path(name)
    if name is not None and (inside := _in_folder(Path(name))):
        return inside
    folders = () if parent is None else run_folders(parent)
    name, place = (None, 0) if name is None else name_and_place(name)
    fitting = [f for f in folders if name is None or name in (f.name, config_of(f))]
    recorded = [f / RECORDING for f in fitting if (f / RECORDING).is_file()]
    if place < len(recorded):
        return recorded[place]
    if recorded:
        count = with_number(len(recorded), "run")
        raise RecordingError(f"only {count} of `{name}` recorded")
    how = (
        "make a recording with `obk launch --record`, or with `obk record` while a stack is running"
    )
    if name is None:
        raise RecordingError(f"no run in {parent} was recorded", help=how)
    if fitting:
        raise RecordingError(f"the run `{name}` was not recorded", help=how)
    names = dict.fromkeys(config_of(folder) for folder in folders)
    raise RecordingError(
        f"no file or run is called `{name}`", help=did_you_mean(name, names) or how
    )


def _in_folder(folder: Path) -> Path | None:
    """Return the only recording in a folder, such as a rosbag2 folder; None if there is none."""
    exists = os.path.isdir(folder)  # noqa: PTH112  (`Path.is_dir` raises)
    files = sorted(folder.glob("*.mcap")) if exists else []
    return files[0] if len(files) == 1 else None
