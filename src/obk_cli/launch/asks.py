"""What others may ask of a running stack, and what they are answered, as values.

Asked by the state node (any ROS 2 client), by the control socket (`obk lifecycle`, `obk ps`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from obelisk_spec.runtime_protocol import Rate

__all__ = [
    "ChangeAnswer",
    "ChangeAsked",
    "Member",
    "NodeStatus",
    "Result",
    "StackStatus",
    "StatusAsked",
]

Result = Literal["reached", "there already", "refused", "timed out", "gone", "taken back"]
"""How a node's part of a transition ended."""


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
        """Whether the transition failed for this one."""
        return self.result in ("refused", "timed out", "gone")


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeAnswer:
    """How a group's transition ended."""

    success: bool
    why: str = ""
    """One sentence that names the culprit; empty on success."""
    members: tuple[Member, ...] = ()
    """In the order in which they were asked; empty where nothing was begun."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeAsked:
    """Somebody wants nodes taken through a transition; answered once, at the latest at the end."""

    transition: str
    reply: Callable[[ChangeAnswer], None]
    """May be called from any thread; must return at once."""
    nodes: tuple[str, ...] = ()
    """Full names; empty: the whole stack."""
    timeout_s: float | None = None
    """For each node's transition [s]; None: the launch's own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeStatus:
    """One node as its launcher sees it."""

    node: str
    section: str
    device: str
    state: str
    """Life-cycle state; `unknown` before the node was heard of, empty for nodes without one."""
    process: str
    """The unit that runs it; equal to `node` where that is a process of its own."""
    pid: int | None
    """None: not running, or on another device."""
    restarts: int
    hangs: bool
    rates: tuple[Rate, ...] = ()
    """The node's promises as it reported them last, while it is active."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StackStatus:
    """A whole stack as its launcher sees it."""

    name: str
    state: str
    """The furthest state that every node has reached, or the transition under way."""
    phase: str
    seconds: float
    """Since the launch [s]."""
    nodes: tuple[NodeStatus, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class StatusAsked:
    """Somebody wants to know how the stack is; answered at once, also during a transition."""

    reply: Callable[[StackStatus], None]
