"""Publishers that a user of this host has let move a robot: `obk topic pub --allow-foreign`.

Known by the name of their node, which such a command alone has, and by the process that the name
tells of. Whoever has the name on another host, or as another user, is a stranger.
"""

import os
import re
from pathlib import Path
from typing import Final

from obk_cli.process.identity import start_s

__all__ = ["ALLOWED_PUBLISHER", "is_allowed_publisher"]

ALLOWED_PUBLISHER: Final = "obk_allowed_publisher"
"""The node's name; the process id follows."""
_NODE: Final = re.compile(rf"/{ALLOWED_PUBLISHER}_(?P<pid>[1-9]\d{{0,9}})", re.ASCII)


def is_allowed_publisher(node: str, since_s: float) -> bool:
    """Whether a node is of a command of this user that began after a time.

    Args:
        node: full name.
        since_s: what began before was not meant for what runs since [s since boot].
    """
    match = _NODE.fullmatch(node)
    if match is None:
        return False
    pid = int(match["pid"])
    try:
        is_own = Path(f"/proc/{pid}").stat().st_uid == os.geteuid()
    except OSError:
        return False
    start = start_s(pid)
    return is_own and start is not None and start >= since_s
