"""The lifecycle of a stack: its numbered edges, the order of tiers, pending requests.

`EDGES`, which ROS clients see, follow from `obk_cli.runs.lifecycle.TRANSITIONS`.
Source: https://design.ros2.org/articles/node_lifecycle.html; lifecycle_msgs/msg/State,
lifecycle_msgs/msg/Transition; rcl_lifecycle's default state machine.
"""

from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from obk_cli.runs.lifecycle import (
    ACTIVE,
    FINALIZED,
    INACTIVE,
    RESTING,
    TRANSITIONS,
    UNCONFIGURED,
    Transition,
)

if TYPE_CHECKING:
    from obk_cli.launch.events import Answered, Failed, StateSeen
    from obk_cli.plan.plan import Plan

__all__ = [
    "EDGES",
    "PASSED",
    "STATES",
    "UNKNOWN",
    "UNTIL",
    "WAY_DOWN",
    "Edge",
    "PendingRequests",
    "Until",
    "edge_between",
    "edges_from",
    "find_edge",
    "tiers_down",
    "tiers_up",
    "way_up",
]

UNKNOWN: Final = "unknown"

STATES: Final = {
    UNKNOWN: 0,
    UNCONFIGURED: 1,
    INACTIVE: 2,
    ACTIVE: 3,
    FINALIZED: 4,
    "configuring": 10,
    "cleaningup": 11,
    "shuttingdown": 12,
    "activating": 13,
    "deactivating": 14,
    "errorprocessing": 15,
}
"""State label -> its number in ROS."""

Until = Literal["none", "configured", "active"]
UNTIL: Final[dict[Until, str]] = {"none": UNCONFIGURED, "configured": INACTIVE, "active": ACTIVE}
"""How far a bring-up goes -> the stack's state when it is done."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Edge:
    """A step from one state to the next, as ROS clients know it."""

    number: int
    label: str
    start: str
    goal: str


def _edges() -> Iterator[Edge]:
    for t in TRANSITIONS.values():
        for start, number in t.numbers.items():
            yield Edge(number=number, label=t.name, start=start, goal=t.passes)
            if t.failure is not None:
                label = "transition_failure"
                yield Edge(number=t.failure, label=label, start=t.passes, goal=start)
        yield Edge(number=t.success, label="transition_success", start=t.passes, goal=t.goal)


EDGES: Final = tuple(sorted(_edges(), key=lambda edge: edge.number))
"""The edges of a stack. Failures are rolled back, so error processing is not among them."""

PASSED: Final = {t.passes: t.name for t in TRANSITIONS.values()}
"""State of a node during a transition -> the transition."""

WAY_DOWN: Final = tuple(TRANSITIONS[name] for name in ("deactivate", "cleanup", "shutdown"))
"""The transitions from `active` to `finalized`, one by one."""


def edges_from(state: str) -> tuple[Edge, ...]:
    """The edges that a client can request in a state; none during a transition."""
    return tuple(edge for edge in EDGES if edge.start == state and state in RESTING)


def find_edge(state: str, label: str, number: int) -> Edge | None:
    """The edge that a request names; None if the state does not allow it.

    Args:
        state: of the stack.
        label: as requested, `activate`; if empty, `number` is used.
        number: as requested.
    """
    for edge in edges_from(state):
        if edge.label == label if label else edge.number == number:
            return edge
    return None


def edge_between(start: str, goal: str) -> Edge | None:
    """The edge from one state directly to another."""
    return next((edge for edge in EDGES if (edge.start, edge.goal) == (start, goal)), None)


def way_up(state: str) -> tuple[Transition, ...]:
    """The transitions from `unconfigured` to a state; empty if none lead there."""
    names = {INACTIVE: ("configure",), ACTIVE: ("configure", "activate")}
    return tuple(TRANSITIONS[name] for name in names.get(state, ()))


def tiers_up(plan: "Plan") -> tuple[tuple[str, ...], ...]:
    """Full names by tier in bring-up order: the robot before controllers.

    Nodes without a lifecycle make no transitions and are left out.
    """
    tiers = (tuple(p.full_name for p in tier if p.has_lifecycle) for tier in plan.tiers)
    return tuple(tier for tier in tiers if tier)


def tiers_down(plan: "Plan") -> tuple[tuple[str, ...], ...]:
    """Full names by tier in shutdown order: controllers before the robot."""
    return tuple(reversed(tiers_up(plan)))


class PendingRequests:
    """The transitions requested here whose `transition_event` has not arrived yet.

    A response and its event arrive on two paths, in either order, and an old event must not
    override the latest state. So the response counts, and the event of the same transition is
    dropped.
    """

    def __init__(self) -> None:
        self._expected: Counter[tuple[str, str]] = Counter()
        self._timed_out: dict[tuple[str, str], float] = {}

    def add(self, node: str, transition: str) -> None:
        """Record that a transition was requested."""
        self._expected[node, transition] += 1
        self._timed_out.pop((node, transition), None)

    def time_out(self, node: str, transition: str, requested_s: float) -> None:
        """Stop waiting for the response to the request sent at that time; it may still arrive."""
        self._timed_out[node, transition] = requested_s

    def pop_late(self, answer: "Answered") -> float | None:
        """When the request of a late response was sent; None: it had not timed out."""
        return self._timed_out.pop((answer.node, answer.transition), None)

    def forget(self, nodes: Collection[str]) -> None:
        """Forget the requests to nodes whose process has ended."""
        for transition in [known for known in self._expected if known[0] in nodes]:
            del self._expected[transition]
        for transition in [known for known in self._timed_out if known[0] in nodes]:
            del self._timed_out[transition]

    def pop(self, event: "StateSeen | Failed") -> bool:
        """Whether an event belongs to a request made here; removes that request."""
        transition = (event.node, event.transition)
        if self._expected[transition] == 0:
            return False
        self._expected[transition] -= 1
        return True
