"""The control protocol: one JSON line asks a run's launcher, one JSON line answers.

Bytes to values and back, checked against their types; what is no request is answered by a sentence.
Questions about the ROS graph travel as they are: `introspect.protocol` has their types.
"""

import json
import math
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal, TypeVar, cast

import msgspec

from obelisk_spec.runtime_protocol import Rate

__all__ = [
    "CONTROL_SOCKET",
    "LONGEST_ANSWER",
    "LONGEST_REQUEST",
    "LONGEST_WAIT_S",
    "ChangeAnswer",
    "ChangeRequest",
    "Fault",
    "GraphAnswer",
    "GraphRequest",
    "Member",
    "NodeStatus",
    "Request",
    "Result",
    "StackStatus",
    "StatusRequest",
    "StopRequest",
    "Stopping",
    "change_data",
    "decode",
    "decode_answer",
    "decode_request",
    "encode",
    "encode_line",
]

T = TypeVar("T")

CONTROL_SOCKET: Final = "control.sock"
"""In the run's folder."""
LONGEST_REQUEST: Final = 1 << 16
"""[bytes]"""
LONGEST_ANSWER: Final = 1 << 24
"""A stack of many nodes, each with a traceback [bytes]."""
LONGEST_WAIT_S: Final = 3600.0
LONGEST_REASON: Final = 200
LONGEST_DETAIL: Final = 200

TransitionName = Literal["configure", "activate", "deactivate", "cleanup", "shutdown"]
Result = Literal["reached", "there already", "refused", "timed out", "gone", "taken back"]
"""How a node's part of a transition ended."""


class StatusRequest(msgspec.Struct, frozen=True, kw_only=True, tag_field="ask", tag="status"):
    """Ask for the state of the stack."""


class ChangeRequest(
    msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="ask", tag="change"
):
    """Take nodes through a transition."""

    transition: TransitionName
    nodes: tuple[str, ...] = ()
    """Full names; empty: the whole stack."""
    timeout_s: Annotated[float, msgspec.Meta(gt=0.0, le=LONGEST_WAIT_S)] | None = None
    """For each node's transition [s]; None: the launch's own."""


class StopRequest(msgspec.Struct, frozen=True, kw_only=True, tag_field="ask", tag="stop"):
    """Bring the stack down and end."""

    reason: str = "asked to stop"


class GraphRequest(msgspec.Struct, frozen=True, kw_only=True, tag_field="ask", tag="look"):
    """Ask the launcher's node about the ROS graph, or about a node's parameters."""

    question: msgspec.Raw


Request = StatusRequest | ChangeRequest | StopRequest | GraphRequest


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """One node's part of a group's transition."""

    node: str
    result: Result
    state: str
    """Where the node is after all."""
    fault: str = ""
    """The node's own words, else empty."""

    @property
    def is_culprit(self) -> bool:
        """Whether the transition failed because of this node."""
        return self.result in ("refused", "timed out", "gone")


class ChangeAnswer(msgspec.Struct, frozen=True, kw_only=True, tag_field="answer", tag="change"):
    """How a group's transition ended."""

    success: bool
    why: str = ""
    """One sentence that names the culprit; empty on success."""
    members: tuple[Member, ...] = ()
    """In the order in which they were asked; empty if nothing was started."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeStatus:
    """One node as its launcher sees it."""

    node: str
    section: str
    device: str
    state: str
    """Life-cycle state; `unknown` before the node was seen, empty for nodes without one."""
    process: str
    """The unit that runs it; equal to `node` if that is a process of its own."""
    pid: int | None
    """None: not running, or on another device."""
    restarts: int
    hangs: bool
    rates: tuple[Rate, ...] = ()
    """The node's rates as it reported them last, while it is active."""


class StackStatus(msgspec.Struct, frozen=True, kw_only=True, tag_field="answer", tag="status"):
    """A whole stack as its launcher sees it."""

    name: str
    state: str
    """The furthest state that every node has reached, or the transition under way."""
    phase: str
    seconds: float
    """Since the launch [s]."""
    nodes: tuple[NodeStatus, ...]


class Stopping(msgspec.Struct, frozen=True, kw_only=True, tag_field="answer", tag="stopping"):
    """The stack will stop."""


class GraphAnswer(msgspec.Struct, frozen=True, kw_only=True, tag_field="answer", tag="look"):
    """What the launcher's node answers about the ROS graph."""

    value: msgspec.Raw = msgspec.field(name="told")


class Fault(msgspec.Struct, frozen=True, kw_only=True):
    """Why there is no answer."""

    error: str


Answer = StackStatus | ChangeAnswer | Stopping | GraphAnswer | Fault


def encode_line(value: Request | Answer) -> bytes:
    """A request or an answer as a line."""
    if isinstance(value, StackStatus) and not math.isfinite(value.seconds):
        value = msgspec.structs.replace(value, seconds=0.0)
    return encode(value) + b"\n"


def encode(value: object) -> bytes:
    """A value as JSON; bytes that are no text, such as in a node's last words, become `?`."""
    try:
        return msgspec.json.encode(value)
    except UnicodeEncodeError:
        text = json.dumps(msgspec.to_builtins(value), ensure_ascii=False)
        return text.encode(errors="replace")


def decode(data: bytes | msgspec.Raw, kind: Any) -> Any:
    """The value that JSON describes.

    Args:
        data: from another process.
        kind: the type of the value; fields that it does not have are ignored.

    Raises:
        ValueError: it describes no such value; the message explains what is wrong, and where.
    """
    try:
        return msgspec.json.decode(data, type=kind)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


def decode_request(line: bytes) -> Request | Fault:
    """The request in a line, or what is wrong with it."""
    try:
        request = cast(Request, decode(line, Request))
    except ValueError as error:
        detail = "".join(c if c.isprintable() else "?" for c in str(error)[:LONGEST_DETAIL])
        return Fault(error=f"invalid request: {detail}")
    if isinstance(request, StopRequest):
        return StopRequest(reason=request.reason[:LONGEST_REASON])
    return request


def decode_answer(line: bytes, kind: type[T]) -> T | Fault | None:
    """The answer in a line; None: it is neither of this kind nor a fault."""
    for expected in (kind, Fault):
        try:
            return cast("T | Fault", decode(line, expected))
        except ValueError:
            continue
    return None


def change_data(answer: ChangeAnswer) -> dict[str, Any]:
    """A transition's end as JSON's values, for a program."""
    data: dict[str, Any] = msgspec.to_builtins(answer)
    del data["answer"]
    return data
