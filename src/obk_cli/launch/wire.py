"""What goes over a run's control socket: one JSON line asks, one JSON line answers.

Pure: bytes to values and back. What comes from outside is checked; a fault is a sentence. Answers
that are more than JSON are in `answers`, so that who looks at the ROS graph needs none of them.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

from obk_cli.launch.transitions import TRANSITIONS

__all__ = [
    "CONTROL_SOCKET",
    "HEARD",
    "LONGEST_ANSWER",
    "LONGEST_REQUEST",
    "LONGEST_WAIT_S",
    "ChangeRequest",
    "LookRequest",
    "Request",
    "StatusRequest",
    "StopRequest",
    "emit_fault",
    "emit_line",
    "emit_look",
    "emit_request",
    "is_stop_heard",
    "parse_line",
    "parse_look",
    "parse_request",
]

CONTROL_SOCKET: Final = "control.sock"
"""In the run's folder."""
LONGEST_REQUEST: Final = 1 << 16
LONGEST_ANSWER: Final = 1 << 24
"""A stack of many nodes, each with a traceback [bytes]."""
LONGEST_WAIT_S: Final = 3600.0
LONGEST_REASON: Final = 200
HEARD: Final = b'{"answer": "stopping"}\n'
"""Answers the request to stop."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StatusRequest:
    """How is the stack?"""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeRequest:
    """Take nodes through a transition."""

    transition: str
    nodes: tuple[str, ...] = ()
    """Full names; empty: the whole stack."""
    timeout_s: float | None = None
    """For each node's transition [s]; None: the launch's own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StopRequest:
    """Bring the stack down and end."""

    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LookRequest:
    """What does the launcher's node know of the ROS graph?"""

    question: Mapping[str, Any]
    """JSON, as `adapters.ros_answers` takes it."""


Request = StatusRequest | ChangeRequest | StopRequest | LookRequest


def emit_request(request: Request) -> bytes:
    """The line that asks."""
    match request:
        case StatusRequest():
            return emit_line({"ask": "status"})
        case ChangeRequest():
            return emit_line({"ask": "change", **asdict(request)})
        case StopRequest():
            return emit_line({"ask": "stop", "reason": request.reason})
        case LookRequest():
            return emit_line({"ask": "look", "question": request.question})


def parse_request(line: bytes) -> Request | str:
    """What a line asks for, or what is wrong with it."""
    data = parse_line(line)
    if data is None:
        return "a request is one line with a JSON object"
    match data.get("ask"):
        case "status":
            return StatusRequest()
        case "change":
            return _change(data)
        case "stop":
            reason = data.get("reason", "asked to stop")
            return (
                StopRequest(reason=reason[:LONGEST_REASON])
                if isinstance(reason, str)
                else "`reason` is a text"
            )
        case "look":
            question = data.get("question")
            if not isinstance(question, dict):
                return "`question` is an object"
            return LookRequest(question=question)
        case other:
            return f"`ask` is `status`, `change`, `look` or `stop`, not {json.dumps(other)[:40]}"


def _change(data: Mapping[str, Any]) -> ChangeRequest | str:
    transition, nodes = data.get("transition"), data.get("nodes", [])
    timeout = data.get("timeout_s")
    if transition not in tuple(TRANSITIONS):
        return f"`transition` is one of {', '.join(TRANSITIONS)}"
    if not isinstance(nodes, list) or not all(isinstance(node, str) for node in nodes):
        return "`nodes` is a list of full names"
    is_number = isinstance(timeout, int | float) and not isinstance(timeout, bool)
    if timeout is not None and not (is_number and 0 < timeout <= LONGEST_WAIT_S):
        return f"`timeout_s` is a number of seconds above 0, at most {LONGEST_WAIT_S:g}"
    return ChangeRequest(transition=transition, nodes=tuple(nodes), timeout_s=timeout)


def emit_look(answer: Mapping[str, Any]) -> bytes:
    """The line that answers a question about the ROS graph."""
    return emit_line({"answer": "look", "told": answer})


def emit_fault(sentence: str) -> bytes:
    """The line that says what is wrong with a request."""
    return emit_line({"error": sentence})


def parse_look(line: bytes) -> Mapping[str, Any] | None:
    """What is told of the ROS graph in an answer; None where there is none."""
    told = (parse_line(line) or {}).get("told")
    return told if isinstance(told, dict) else None


def is_stop_heard(line: bytes) -> bool:
    """Whether an answer says that the stack will stop."""
    return line == HEARD


def parse_line(line: bytes) -> Mapping[str, Any] | None:
    """The JSON object of a line; None where it holds none."""
    try:
        data = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return data if isinstance(data, dict) else None


def emit_line(data: Mapping[str, object]) -> bytes:
    """A JSON object as a line."""
    return json.dumps(data).encode() + b"\n"
