"""Asking a running stack of this host over its control socket; each question has a deadline.

Takes a run's folder, gives what its launcher answered, or None where it did not. Raises nothing.
"""

import os
import socket
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from obk_cli.launch.wire import (
    CONTROL_SOCKET,
    LONGEST_ANSWER,
    ChangeRequest,
    LookRequest,
    Request,
    StatusRequest,
    StopRequest,
    emit_request,
    is_stop_heard,
    parse_look,
)

if TYPE_CHECKING:
    from obk_cli.launch.asks import ChangeAnswer, StackStatus

__all__ = ["ANSWER_S", "ask_change", "ask_look", "ask_status", "ask_stop"]

ANSWER_S: Final = 3.0
"""How long a launcher that is well may take at most to say how its stack is: ms, but seconds on a
machine with much else to do [s]."""
PIECE: Final = 1 << 16


def ask_status(folder: Path, timeout_s: float = ANSWER_S) -> "StackStatus | None":
    """How the stack of a run is; None: no answer in time."""
    from obk_cli.launch.answers import parse_status

    line = _ask(folder, StatusRequest(), timeout_s)
    return None if line is None else parse_status(line)


def ask_change(
    folder: Path,
    transition: str,
    nodes: tuple[str, ...] = (),
    *,
    timeout_s: float | None,
    wait_s: float,
) -> "ChangeAnswer | None":
    """Take a stack's nodes through a transition.

    Args:
        folder: the run's.
        transition: `activate`, ...
        nodes: full names; empty: the whole stack.
        timeout_s: for each node's transition [s]; None: the launch's own.
        wait_s: for the answer, that is for all nodes, and for the way back [s].

    Returns:
        How it ended, or None when no answer came in time.
    """
    from obk_cli.launch.answers import parse_change

    request = ChangeRequest(transition=transition, nodes=nodes, timeout_s=timeout_s)
    line = _ask(folder, request, wait_s)
    return None if line is None else parse_change(line)


def ask_look(
    folder: Path, question: Mapping[str, Any], timeout_s: float = ANSWER_S
) -> Mapping[str, Any] | None:
    """What the launcher's node knows of the ROS graph; None: no answer in time.

    Args:
        folder: the run's.
        question: see `adapters.ros_answers`.
        timeout_s: for the answer [s].
    """
    line = _ask(folder, LookRequest(question=question), timeout_s)
    return None if line is None else parse_look(line)


def ask_stop(folder: Path, reason: str, timeout_s: float = ANSWER_S) -> bool:
    """Ask for a stack's end; whether the launcher has heard it."""
    line = _ask(folder, StopRequest(reason=reason), timeout_s)
    return line is not None and is_stop_heard(line)


def _ask(folder: Path, request: Request, timeout_s: float) -> bytes | None:
    end = time.monotonic() + timeout_s
    try:
        folder_fd = os.open(folder, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as link:
            link.settimeout(timeout_s)
            # Through the descriptor: an address has 107 bytes, and the path may have more.
            link.connect(f"/proc/self/fd/{folder_fd}/{CONTROL_SOCKET}")
            link.sendall(emit_request(request))
            return _line(link, end)
    except OSError:
        return None
    finally:
        os.close(folder_fd)


def _line(link: socket.socket, end: float) -> bytes | None:
    line = bytearray()
    while not line.endswith(b"\n") and len(line) < LONGEST_ANSWER:
        left_s = end - time.monotonic()
        if left_s <= 0:
            return None
        link.settimeout(left_s)
        piece = link.recv(PIECE)
        if not piece:
            return None
        line += piece
    return bytes(line)
