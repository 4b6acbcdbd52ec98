"""The folder of ROS's own log files, without which no process of ROS starts.

Takes variables, gives a sentence about what had to be changed in them. Makes a folder only where
ROS could have none. What nodes say is in the run's logs all the same.
Source: rcl_logging_interface, `rcl_logging_get_logging_directory`.
"""

import os
import shutil
import tempfile
from collections.abc import Iterator, MutableMapping
from pathlib import Path
from typing import Final

__all__ = ["set_log_folder"]

LOGS: Final = "ROS_LOG_DIR"
ROS_HOME: Final = "ROS_HOME"


def set_log_folder(variables: MutableMapping[str, str]) -> Iterator[str]:
    """Have ROS write its log files where it can; gives a sentence where that is another place."""
    fault = _fault(variables)
    if fault is None:
        return
    try:
        instead = _folder_of_this_user()
    except OSError as error:
        yield f"ROS will not start: {fault}, nor elsewhere ({error})"
        return
    if logs := variables.pop(LOGS, ""):
        # The runs are where they are without this.
        variables.setdefault("OBK_HOME", f"{logs}/obk")
    variables[ROS_HOME] = str(instead)
    yield f"{fault}; they go to {instead}/log"


def _fault(variables: MutableMapping[str, str]) -> str | None:
    """Why ROS can write no log files; None: it can."""
    given = variables.get(LOGS) or f"{variables.get(ROS_HOME) or '~/.ros'}/log"
    home = variables.get("HOME", "")
    if given.startswith("~") and not home:
        return "ROS finds no place for its log files, as HOME is not set"
    folder = Path(home, given[1:].lstrip("/")) if given.startswith("~") else Path(given).absolute()
    # `Path.exists` raises in a folder that is closed to this user, such as the home of root.
    there = next(place for place in (folder, *folder.parents) if os.path.exists(place))  # noqa: PTH110
    if not (there.is_dir() and os.access(there, os.W_OK | os.X_OK)):
        return f"ROS cannot write its log files into {folder}"
    if there != folder and not shutil.disk_usage(there).free:
        return f"ROS cannot make {folder} for its log files, as the disk is full"
    return None


def _folder_of_this_user() -> Path:
    """A folder for temporary files that is nobody else's.

    Raises:
        OSError: there is none.
    """
    folder = Path(tempfile.gettempdir()) / f"obk-ros-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    if folder.lstat().st_uid != os.getuid():
        raise PermissionError(f"{folder} is another user's")
    return folder
