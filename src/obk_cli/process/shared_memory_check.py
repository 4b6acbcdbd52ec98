"""Require room in shared memory before ROS is loaded.

The tracing library of ROS maps a page of a file there and writes to it. If no room is left for that
page, the kernel ends the process with SIGBUS. Segments that dead Fast DDS processes left behind are
what fills shared memory.
"""

import os
import shutil
from pathlib import Path
from typing import Final

from obk_cli.errors import CommandFailedError
from obk_cli.process.shared_memory import SHARED_MEMORY, remove_dead_segments

__all__ = ["require_shared_memory"]

NEEDED: Final = 1 << 14
"""For a few pages [bytes]."""


def require_shared_memory(folder: Path = SHARED_MEMORY) -> None:
    """Make sure that ROS can be loaded; what nobody uses makes room.

    Raises:
        CommandFailedError: the shared memory is full.
    """
    if _is_full(folder):
        remove_dead_segments(folder)
    if _is_full(folder):
        raise CommandFailedError(
            f"{folder} is full: whoever loads ROS would be ended by SIGBUS",
            help="remove what is in it, or see `obk doctor shared-memory`",
        )


def _is_full(folder: Path) -> bool:
    # ROS does without a folder that takes nothing at all.
    return os.access(folder, os.W_OK) and shutil.disk_usage(folder).free < NEEDED
