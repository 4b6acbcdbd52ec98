"""Shared-memory segments of Fast DDS that nobody owns any more.

A process that is killed leaves its segments behind, half a megabyte each. The owner of a segment
holds an exclusive flock on the empty file beside it (`fastrtps_<id>_el`) for as long as it lives,
whatever ends it; so a lock that is free tells of a dead owner. Ports, which processes share, are
left to Fast DDS itself.
"""

import fcntl
import os
import re
from pathlib import Path
from typing import Final

__all__ = ["remove_dead_segments"]

SHARED_MEMORY: Final = Path("/dev/shm")
_LOCK: Final = re.compile(r"fastrtps_[0-9a-f]{16}_el")


def remove_dead_segments(folder: Path = SHARED_MEMORY) -> int:
    """Remove the segments whose owners are gone; gives how many there were.

    Segments of other users, and of living processes, are left alone.
    """
    locks = [path for path in folder.glob("fastrtps_*_el") if _LOCK.fullmatch(path.name)]
    return sum(_remove_if_dead(lock) for lock in locks)


def _remove_if_dead(lock: Path) -> bool:
    try:
        descriptor = os.open(lock, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        lock.with_name(lock.name.removesuffix("_el")).unlink(missing_ok=True)
        lock.unlink(missing_ok=True)
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return True
