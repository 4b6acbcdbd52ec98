"""The life cycle's states and edges with the numbers and labels that ROS clients know them by.

Pure data and look-ups, for the stack as a whole as for one node; nothing is changed here.
Source: lifecycle_msgs/msg/State, lifecycle_msgs/msg/Transition; rcl_lifecycle's default machine.
"""

from dataclasses import dataclass
from typing import Final

__all__ = [
    "EDGES",
    "PASSED",
    "STATES",
    "UNKNOWN",
    "Edge",
    "edge_between",
    "edges_from",
    "find_edge",
]

UNKNOWN: Final = "unknown"

STATES: Final = {
    UNKNOWN: 0,
    "unconfigured": 1,
    "inactive": 2,
    "active": 3,
    "finalized": 4,
    "configuring": 10,
    "cleaningup": 11,
    "shuttingdown": 12,
    "activating": 13,
    "deactivating": 14,
    "errorprocessing": 15,
}
"""Label -> number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Edge:
    """From one state to the next; one that a user can ask for begins in a resting state."""

    number: int
    label: str
    start: str
    goal: str


_ASKED: Final = (
    Edge(number=1, label="configure", start="unconfigured", goal="configuring"),
    Edge(number=2, label="cleanup", start="inactive", goal="cleaningup"),
    Edge(number=3, label="activate", start="inactive", goal="activating"),
    Edge(number=4, label="deactivate", start="active", goal="deactivating"),
    Edge(number=5, label="shutdown", start="unconfigured", goal="shuttingdown"),
    Edge(number=6, label="shutdown", start="inactive", goal="shuttingdown"),
    Edge(number=7, label="shutdown", start="active", goal="shuttingdown"),
)
_OUTCOMES: Final = tuple(
    Edge(number=number, label=label, start=start, goal=goal)
    for number, label, start, goal in (
        (10, "transition_success", "configuring", "inactive"),
        (11, "transition_failure", "configuring", "unconfigured"),
        (20, "transition_success", "cleaningup", "unconfigured"),
        (21, "transition_failure", "cleaningup", "inactive"),
        (30, "transition_success", "activating", "active"),
        (31, "transition_failure", "activating", "inactive"),
        (40, "transition_success", "deactivating", "inactive"),
        (41, "transition_failure", "deactivating", "active"),
        (50, "transition_success", "shuttingdown", "finalized"),
    )
)
EDGES: Final = _ASKED + _OUTCOMES
"""Those of a stack: what fails is taken back, so there is no error processing among them."""

PASSED: Final = {edge.goal: edge.label for edge in _ASKED}
"""State that a transition passes through -> transition."""


def edges_from(state: str) -> tuple[Edge, ...]:
    """What can be asked for in a state, empty in the middle of a transition."""
    return tuple(edge for edge in _ASKED if edge.start == state)


def find_edge(state: str, label: str, number: int) -> Edge | None:
    """The edge that a request means in a state; None where it is not possible there.

    Args:
        state: where the stack is.
        label: as the request has it, `activate`; when it is empty the number counts.
        number: as the request has it.
    """
    for edge in edges_from(state):
        if edge.label == label if label else edge.number == number:
            return edge
    return None


def edge_between(start: str, goal: str) -> Edge | None:
    """The edge that leads from one state to another at once."""
    return next((edge for edge in EDGES if (edge.start, edge.goal) == (start, goal)), None)
