"""The lifecycle of a node: its states, and the transitions that a user can request.

Source: https://design.ros2.org/articles/node_lifecycle.html; lifecycle_msgs/msg/State,
lifecycle_msgs/msg/Transition; rcl_lifecycle's default state machine.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

__all__ = [
    "ACTIVE",
    "FINALIZED",
    "INACTIVE",
    "RESTING",
    "TRANSITIONS",
    "UNCONFIGURED",
    "Transition",
]

UNCONFIGURED: Final = "unconfigured"
INACTIVE: Final = "inactive"
ACTIVE: Final = "active"
FINALIZED: Final = "finalized"
RESTING: Final = frozenset({UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED})
"""States in which a node stays until a transition is requested."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Transition:
    """A transition that a user can request."""

    name: str
    numbers: Mapping[str, int]
    """State in which it is allowed -> its number in ROS."""
    goal: str
    passes: str
    """The state of a node during the transition."""
    success: int
    """Its ROS number if it succeeds."""
    failure: int | None = None
    """Its ROS number if it fails; None: ROS has none."""
    undo: str | None = None
    """The transition that undoes it."""

    @property
    def starts(self) -> frozenset[str]:
        """States in which it is allowed."""
        return frozenset(self.numbers)

    @property
    def is_up(self) -> bool:
        """Whether it leads towards `active`; the robot then comes first."""
        return self.name in ("configure", "activate")


TRANSITIONS: Final = {
    t.name: t
    for t in (
        Transition(
            name="configure",
            numbers={UNCONFIGURED: 1},
            goal=INACTIVE,
            passes="configuring",
            success=10,
            failure=11,
            undo="cleanup",
        ),
        Transition(
            name="activate",
            numbers={INACTIVE: 3},
            goal=ACTIVE,
            passes="activating",
            success=30,
            failure=31,
            undo="deactivate",
        ),
        Transition(
            name="deactivate",
            numbers={ACTIVE: 4},
            goal=INACTIVE,
            passes="deactivating",
            success=40,
            failure=41,
            undo="activate",
        ),
        Transition(
            name="cleanup",
            numbers={INACTIVE: 2},
            goal=UNCONFIGURED,
            passes="cleaningup",
            success=20,
            failure=21,
            undo="configure",
        ),
        Transition(
            name="shutdown",
            numbers={UNCONFIGURED: 5, INACTIVE: 6, ACTIVE: 7},
            goal=FINALIZED,
            passes="shuttingdown",
            success=50,
        ),
    )
}
