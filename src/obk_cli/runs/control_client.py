"""Ask a running stack of this host over its control socket; each request has a deadline.

Takes a run's folder, gives what its launcher answered, or None if it did not. Raises nothing.
"""

import os
import socket
import time
from pathlib import Path
from typing import Final, TypeVar

import msgspec

from obk_cli.runs.protocol import (
    CONTROL_SOCKET,
    LONGEST_ANSWER,
    ChangeAnswer,
    ChangeRequest,
    Fault,
    GraphAnswer,
    GraphRequest,
    Request,
    StackStatus,
    StatusRequest,
    Stopping,
    StopRequest,
    decode_answer,
    encode_line,
)

__all__ = ["ANSWER_S", "ask_change", "ask_graph", "ask_status", "ask_stop"]

T = TypeVar("T")

ANSWER_S: Final = 3.0
"""How long a healthy launcher may take to describe its stack: ms, but seconds on a busy machine
[s]."""
PIECE: Final = 1 << 16


def ask_status(folder: Path, timeout_s: float = ANSWER_S) -> StackStatus | None:
    """The state of a run's stack; None: no answer in time."""
    answer = _ask(folder, StatusRequest(), StackStatus, timeout_s)
    return answer if isinstance(answer, StackStatus) else None


def ask_change(
    folder: Path,
    transition: str,
    nodes: tuple[str, ...] = (),
    *,
    timeout_s: float | None,
    wait_s: float,
) -> ChangeAnswer | None:
    """Take a stack's nodes through a transition.

    Args:
        folder: the run's.
        transition: `activate`, ...
        nodes: full names; empty: the whole stack.
        timeout_s: for each node's transition [s]; None: the launch's own.
        wait_s: for the answer, that is for all nodes, and for the way back [s].

    Returns:
        How it ended; a fault that the launcher reports is a failure. None: no answer in time.
    """
    request = ChangeRequest(transition=transition, nodes=nodes, timeout_s=timeout_s)  # type: ignore[arg-type]
    answer = _ask(folder, request, ChangeAnswer, wait_s)
    return ChangeAnswer(success=False, why=answer.error) if isinstance(answer, Fault) else answer


def ask_graph(
    folder: Path, question: bytes, timeout_s: float = ANSWER_S
) -> msgspec.Raw | Fault | None:
    """What the launcher's node answers about the ROS graph; None: no answer in time.

    Args:
        folder: the run's.
        question: JSON, see `introspect.protocol`.
        timeout_s: for the answer [s].
    """
    request = GraphRequest(question=msgspec.Raw(question))
    answer = _ask(folder, request, GraphAnswer, timeout_s)
    return answer.value if isinstance(answer, GraphAnswer) else answer


def ask_stop(folder: Path, reason: str, timeout_s: float = ANSWER_S) -> bool:
    """Ask for a stack's end; returns whether the launcher confirms the request."""
    return isinstance(_ask(folder, StopRequest(reason=reason), Stopping, timeout_s), Stopping)


def _ask(folder: Path, request: Request, kind: type[T], timeout_s: float) -> T | Fault | None:
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
            link.sendall(encode_line(request))
            line = _line(link, end)
    except OSError:
        return None
    finally:
        os.close(folder_fd)
    return None if line is None else decode_answer(line, kind)


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
