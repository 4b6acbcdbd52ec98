"""Ask the launcher of a run over its control socket: one JSON line each way.

The requests and answers of the tool are in `obk_cli.runs.protocol`. The runtime library's only
request is here: a robot reports the URL of its viewer's page. The URL contains the token that opens
the page, so it must not reach ROS topics or log files, which other users can read.
"""

import os
import socket
import time
from pathlib import Path
from typing import Final

__all__ = [
    "CONTROL_SOCKET",
    "PAGE_REQUEST",
    "RUN_FOLDER_VARIABLE",
    "ask_launcher",
    "report_page",
]

RUN_FOLDER_VARIABLE: Final = "OBK_RUN_FOLDER"
"""The environment variable with the path of the run's folder, which holds `CONTROL_SOCKET`."""
CONTROL_SOCKET: Final = "control.sock"
"""The launcher's socket in the run's folder; it takes one JSON line per connection."""
PAGE_REQUEST: Final = "page"
"""The value of `ask` in the request by which a robot reports the URL of its viewer's page."""
_LONGEST_ANSWER: Final = 1 << 24
"""Enough for a stack of many nodes, each with a traceback [bytes]."""
_PIECE: Final = 1 << 16
_PAGE_ANSWER_S: Final = 2.0
"""Timeout for the launcher to take a report [s]."""


def ask_launcher(folder: Path, request: bytes, timeout_s: float) -> bytes | None:
    """Send a request to a run's launcher, and wait for the answer.

    Args:
        folder: the run's folder.
        request: one line.
        timeout_s: limit for the answer [s].

    Returns:
        One line; None if there is no launcher, or it does not answer in time.
    """
    end = time.monotonic() + timeout_s
    try:
        folder_fd = os.open(folder, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as link:
            link.settimeout(timeout_s)
            # Through the descriptor: an address is limited to 107 bytes; the path may be longer.
            link.connect(f"/proc/self/fd/{folder_fd}/{CONTROL_SOCKET}")
            link.sendall(request)
            return _receive_line(link, end)
    except OSError:
        return None
    finally:
        os.close(folder_fd)


def _receive_line(link: socket.socket, end: float) -> bytes | None:
    line = bytearray()
    while not line.endswith(b"\n") and len(line) < _LONGEST_ANSWER:
        left_s = end - time.monotonic()
        if left_s <= 0:
            return None
        link.settimeout(left_s)
        piece = link.recv(_PIECE)
        if not piece:
            return None
        line += piece
    return bytes(line)


def report_page(node: str, url: str) -> None:
    """Report the URL of a page to the launcher, or on the terminal without one; thread-safe.

    Args:
        node: full name of the robot.
        url: the URL; empty if the page is gone.
    """
    import json  # nodes that serve no page start faster without it

    folder = os.environ.get(RUN_FOLDER_VARIABLE)
    answer = None
    if folder is not None:
        request = json.dumps({"ask": PAGE_REQUEST, "node": node, "url": url}).encode() + b"\n"
        answer = ask_launcher(Path(folder), request, _PAGE_ANSWER_S)
    if url and (answer is None or b'"noted"' not in answer):
        # Not logged: logs go to a topic, and to files outside the run's folder.
        print(f"the simulation is shown at {url}", flush=True)  # noqa: T201
