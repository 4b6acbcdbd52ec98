"""Report the URL of a simulation's page: to the launcher, or on the terminal without one.

The URL of a page contains the token that opens it. Neither way leads through ROS topics or log
files that other users can read.
"""

import os
import socket
from pathlib import Path
from typing import Final

from obelisk_spec.runtime_protocol import CONTROL_SOCKET, RUN_FOLDER_VARIABLE, page_request

__all__ = ["report_page"]

_ANSWER_S: Final = 2.0
"""Timeout for the launcher to take the report [s]."""
_LONGEST_ANSWER: Final = 1 << 16


def report_page(node: str, url: str) -> None:
    """Report the URL of a page; thread-safe.

    Args:
        node: full name of the robot.
        url: the URL; empty if the page has gone.
    """
    folder = os.environ.get(RUN_FOLDER_VARIABLE)
    is_shown = folder is not None and _ask(Path(folder), page_request(node, url))
    if url and not is_shown:
        # Not logged: logs go to a topic, and to files outside the run's folder.
        print(f"the simulation is shown at {url}", flush=True)  # noqa: T201


def _ask(folder: Path, request: bytes) -> bool:
    """Whether the launcher has taken a request."""
    try:
        folder_fd = os.open(folder, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as link:
            link.settimeout(_ANSWER_S)
            # Through the descriptor: an address is limited to 107 bytes; the path may be longer.
            link.connect(f"/proc/self/fd/{folder_fd}/{CONTROL_SOCKET}")
            link.sendall(request)
            return b'"noted"' in link.recv(_LONGEST_ANSWER)
    except OSError:
        return False
    finally:
        os.close(folder_fd)
