"""What another user has put into a folder where everybody may put something, such as /tmp.

Looks at owners and modes; opens nothing.
"""

import os
import stat
from pathlib import Path
from typing import Final

__all__ = ["is_planted", "is_within_planted"]

FOR_EVERYBODY: Final = stat.S_ISVTX | stat.S_IWOTH
"""Of a folder where each user may put something, and take away nobody else's."""


def is_planted(path: Path) -> bool:
    """Whether it lies in such a folder and is neither this user's nor root's.

    What a user keeps beside it would otherwise be run with it.
    """
    try:
        owner, mode = path.lstat().st_uid, path.parent.stat().st_mode
    except OSError:
        return False
    return owner not in (os.geteuid(), 0) and mode & FOR_EVERYBODY == FOR_EVERYBODY


def is_within_planted(path: Path) -> bool:
    """Whether that holds for it, or for a folder that it lies in."""
    whole = path.absolute()
    return any(map(is_planted, (whole, *whole.parents)))
