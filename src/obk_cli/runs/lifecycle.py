"""The life cycle of a node: its resting states, and the transitions that a user can request.

Source: https://design.ros2.org/articles/node_lifecycle.html
"""

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
"""States in which a node stays until it is asked for something."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Transition:
    """One transition that a user can ask for."""

    name: str
    starts: frozenset[str]
    """States from which it is allowed."""
    goal: str
    passes: str
    """The state in which a node is while it makes it."""
    undo: str | None = None
    """The transition that takes it back."""

    @property
    def is_up(self) -> bool:
        """Whether it leads towards `active`; then the robot comes first."""
        return self.name in ("configure", "activate")


TRANSITIONS: Final = {
    t.name: t
    for t in (
        Transition(
            name="configure",
            starts=frozenset({UNCONFIGURED}),
            goal=INACTIVE,
            passes="configuring",
            undo="cleanup",
        ),
        Transition(
            name="activate",
            starts=frozenset({INACTIVE}),
            goal=ACTIVE,
            passes="activating",
            undo="deactivate",
        ),
        Transition(
            name="deactivate",
            starts=frozenset({ACTIVE}),
            goal=INACTIVE,
            passes="deactivating",
            undo="activate",
        ),
        Transition(
            name="cleanup",
            starts=frozenset({INACTIVE}),
            goal=UNCONFIGURED,
            passes="cleaningup",
            undo="configure",
        ),
        Transition(
            name="shutdown",
            starts=frozenset({UNCONFIGURED, INACTIVE, ACTIVE}),
            goal=FINALIZED,
            passes="shuttingdown",
        ),
    )
}
