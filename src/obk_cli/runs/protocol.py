"""The control protocol: one JSON line queries a run's launcher, one JSON line answers.

This module converts bytes to values and back, checked against their types; an invalid request is
answered with an error. Queries about the ROS graph are passed through: `introspect.protocol` has
their types.

The `ask_*` functions take a run's folder and return the launcher's answer, or None if none arrives
in time. They never raise.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeVar, cast

import msgspec

from obelisk_spec.control_socket import PAGE_REQUEST, ask_launcher
from obelisk_spec.runtime_protocol import Rate

__all__ = [
    "ANSWER_S",
    "LONGEST_REQUEST",
    "LONGEST_WAIT_S",
    "ChangeAnswer",
    "ChangeRequest",
    "Fault",
    "GraphAnswer",
    "GraphRequest",
    "Member",
    "NodeStatus",
    "Noted",
    "PageRequest",
    "Request",
    "Result",
    "StackStatus",
    "StatusRequest",
    "StopRequest",
    "Stopping",
    "ask_change",
    "ask_graph",
    "ask_status",
    "ask_stop",
    "change_data",
    "decode",
    "decode_answer",
    "decode_request",
    "encode",
    "encode_line",
]


T = TypeVar("T")

LONGEST_REQUEST: Final = 1 << 16
"""[bytes]"""
LONGEST_WAIT_S: Final = 3600.0
LONGEST_REASON: Final = 200
LONGEST_DETAIL: Final = 200
PAGE_URL: Final = r"^(http://127\.0\.0\.1:[0-9]{1,5}/\?token=[A-Za-z0-9_-]{1,100})?$"
"""Pattern of a page's URL: on this host, without characters that a terminal would interpret."""

TransitionName = Literal["configure", "activate", "deactivate", "cleanup", "shutdown"]
Result = Literal["reached", "already there", "refused", "timed out", "gone", "rolled back"]
"""How a node's part of a transition ended."""

ANSWER_S: Final = 3.0
"""Time limit for a status reply [s]; normally milliseconds, but seconds on a busy machine."""


class StatusRequest(msgspec.Struct, frozen=True, kw_only=True, tag_field="ask", tag="status"):
    """Request the state of the stack."""


class ChangeRequest(
    msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="ask", tag="change"
):
    """Request a transition of nodes."""

    transition: TransitionName
    nodes: tuple[str, ...] = ()
    """Full names; empty: the whole stack."""
    timeout_s: Annotated[float, msgspec.Meta(gt=0.0, le=LONGEST_WAIT_S)] | None = None
    """Limit for each node's transition [s]; None: the limit set at launch."""


class StopRequest(msgspec.Struct, frozen=True, kw_only=True, tag_field="ask", tag="stop"):
    """Request to shut the stack down."""

    reason: str = "stop requested"


class GraphRequest(msgspec.Struct, frozen=True, kw_only=True, tag_field="ask", tag="look"):
    """Query the launcher's node about the ROS graph, or about a node's parameters."""

    question: msgspec.Raw


class PageRequest(msgspec.Struct, frozen=True, kw_only=True, tag_field="ask", tag=PAGE_REQUEST):
    """Report the URL of a robot's viewer page; see `control_socket.report_page`."""

    node: str
    """Full name of the robot."""
    url: Annotated[str, msgspec.Meta(pattern=PAGE_URL)]
    """Empty if the page has gone."""


Request = StatusRequest | ChangeRequest | StopRequest | GraphRequest | PageRequest


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """One node's part of a transition of several nodes."""

    node: str
    result: Result
    state: str
    """The node's final state."""
    fault: str = ""
    """The fault as the node reported it; otherwise empty."""

    @property
    def is_culprit(self) -> bool:
        """Whether the transition failed because of this node."""
        return self.result in ("refused", "timed out", "gone")


class ChangeAnswer(msgspec.Struct, frozen=True, kw_only=True, tag_field="answer", tag="change"):
    """How a transition of several nodes ended."""

    success: bool
    why: str = ""
    """One sentence that names the node at fault; empty on success."""
    members: tuple[Member, ...] = ()
    """In the order of the requests; empty if nothing was requested."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeStatus:
    """A node's status, as reported by its launcher."""

    node: str
    section: str
    device: str
    state: str
    """Lifecycle state; `unknown` before the node was seen, empty for nodes without one."""
    process: str
    """Name of the process that runs it; equal to `node` if the process is not shared."""
    pid: int | None
    """None: not running, or on another device."""
    restarts: int
    hangs: bool
    rates: tuple[Rate, ...] = ()
    """The node's last reported rates, while it is active."""
    page: str = ""
    """URL of its viewer's page, with the token that opens it; empty without one."""


class StackStatus(msgspec.Struct, frozen=True, kw_only=True, tag_field="answer", tag="status"):
    """A stack's status, as reported by its launcher."""

    name: str
    state: str
    """The furthest state that every node has reached, or the current transition."""
    phase: str
    seconds: float
    """Since the launch [s]."""
    nodes: tuple[NodeStatus, ...]


class Stopping(msgspec.Struct, frozen=True, kw_only=True, tag_field="answer", tag="stopping"):
    """The stack will stop."""


class Noted(msgspec.Struct, frozen=True, kw_only=True, tag_field="answer", tag="noted"):
    """The report was received."""


class GraphAnswer(msgspec.Struct, frozen=True, kw_only=True, tag_field="answer", tag="look"):
    """The launcher's answer to a query about the ROS graph."""

    value: msgspec.Raw


class Fault(msgspec.Struct, frozen=True, kw_only=True):
    """Why there is no answer."""

    error: str


Answer = StackStatus | ChangeAnswer | Stopping | Noted | GraphAnswer | Fault


def encode_line(value: Request | Answer) -> bytes:
    """Encode a request or an answer as a line."""
    if isinstance(value, StackStatus) and not math.isfinite(value.seconds):
        value = msgspec.structs.replace(value, seconds=0.0)
    return encode(value) + b"\n"


def encode(value: object) -> bytes:
    """Encode a value as JSON; invalid bytes, such as in a node's last output, become `?`."""
    try:
        return msgspec.json.encode(value)
    except UnicodeEncodeError:
        text = json.dumps(msgspec.to_builtins(value), ensure_ascii=False)
        return text.encode(errors="replace")


def decode(data: bytes | msgspec.Raw, kind: Any) -> Any:
    """Decode JSON.

    Args:
        data: from another process.
        kind: expected type of the value; unknown fields are ignored.

    Raises:
        ValueError: the JSON does not match the type; the message says what is wrong, and where.
    """
    try:
        return msgspec.json.decode(data, type=kind)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


def decode_request(line: bytes) -> Request | Fault:
    """Decode the request in a line, or return what is wrong with it."""
    try:
        request = cast(Request, decode(line, Request))
    except ValueError as error:
        detail = "".join(c if c.isprintable() else "?" for c in str(error)[:LONGEST_DETAIL])
        return Fault(error=f"invalid request: {detail}")
    if isinstance(request, StopRequest):
        return StopRequest(reason=request.reason[:LONGEST_REASON])
    return request


def decode_answer(line: bytes, kind: type[T]) -> T | Fault | None:
    """Decode the answer in a line; None if it is neither of this kind nor a fault."""
    for expected in (kind, Fault):
        try:
            return cast("T | Fault", decode(line, expected))
        except ValueError:
            continue
    return None


def change_data(answer: ChangeAnswer) -> dict[str, Any]:
    """A transition's result as JSON data."""
    data: dict[str, Any] = msgspec.to_builtins(answer)
    del data["answer"]
    return data


def ask_status(folder: Path, timeout_s: float = ANSWER_S) -> StackStatus | None:
    """The state of a run's stack; None if no answer arrives in time."""
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
        folder: the folder of the run.
        transition: `activate`, ...
        nodes: full names; empty: the whole stack.
        timeout_s: limit for each node's transition [s]; None: the limit set at launch.
        wait_s: limit for the answer, which covers all nodes and a rollback [s].

    Returns:
        The result; a fault that the launcher reports is a failure. None: no answer in time.
    """
    request = ChangeRequest(transition=transition, nodes=nodes, timeout_s=timeout_s)  # type: ignore[arg-type]
    answer = _ask(folder, request, ChangeAnswer, wait_s)
    return ChangeAnswer(success=False, why=answer.error) if isinstance(answer, Fault) else answer


def ask_graph(
    folder: Path, question: bytes, timeout_s: float = ANSWER_S
) -> msgspec.Raw | Fault | None:
    """Query the launcher's node about the ROS graph; None if no answer arrives in time.

    Args:
        folder: the folder of the run.
        question: JSON, see `introspect.protocol`.
        timeout_s: limit for the answer [s].
    """
    request = GraphRequest(question=msgspec.Raw(question))
    answer = _ask(folder, request, GraphAnswer, timeout_s)
    return answer.value if isinstance(answer, GraphAnswer) else answer


def ask_stop(folder: Path, reason: str, timeout_s: float = ANSWER_S) -> bool:
    """Request a shutdown; return whether the launcher confirms the request."""
    return isinstance(_ask(folder, StopRequest(reason=reason), Stopping, timeout_s), Stopping)


def _ask(folder: Path, request: Request, kind: type[T], timeout_s: float) -> T | Fault | None:
    line = ask_launcher(folder, encode_line(request), timeout_s)
    return None if line is None else decode_answer(line, kind)
