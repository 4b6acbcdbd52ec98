"""Which nodes make which transition when: tier by tier, robot first on the way up."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal

from obk_cli.launch.transitions import TRANSITIONS, Transition
from obk_cli.plan import TIERS, Plan

__all__ = ["UNTIL", "Step", "Until", "in_tier_order", "section_of", "steps_up", "tiers_down"]

Until = Literal["none", "configured", "active"]
UNTIL: Final[dict[Until, tuple[str, ...]]] = {
    "none": (),
    "configured": ("configure",),
    "active": ("configure", "activate"),
}
"""How far a bring-up goes, and the transitions on the way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """Nodes that make the same transition at the same time."""

    transition: Transition
    nodes: tuple[str, ...]
    """Full names."""


def steps_up(plan: Plan, until: Until) -> tuple[Step, ...]:
    """All tiers configure, robot first, before the first one activates."""
    return tuple(
        Step(transition=TRANSITIONS[name], nodes=tier)
        for name in UNTIL[until]
        for tier in _life_cycle_tiers(plan)
    )


def tiers_down(plan: Plan) -> tuple[tuple[str, ...], ...]:
    """Full names by tier in the order in which they come down: controllers before the robot."""
    return tuple(reversed(_life_cycle_tiers(plan)))


def _life_cycle_tiers(plan: Plan) -> tuple[tuple[str, ...], ...]:
    """Full names; nodes without a life cycle make no transitions and are left out."""
    tiers = (tuple(p.full_name for p in tier if p.has_lifecycle) for tier in plan.tiers)
    return tuple(tier for tier in tiers if tier)


def section_of(node: str) -> str | None:
    """The section that a node's name tells (`/ns/obelisk_control_0` -> `control`), or None."""
    parts = node.rpartition("/")[2].split("_")
    is_ours = len(parts) > 2 and parts[0] == "obelisk" and parts[1] in TIERS
    return parts[1] if is_ours else None


def in_tier_order(nodes: Iterable[str]) -> tuple[str, ...]:
    """Nodes by the tier that their names tell, unknown ones last."""

    def rank(node: str) -> tuple[int, str]:
        section = section_of(node)
        return (TIERS.index(section) if section else len(TIERS), node)

    return tuple(sorted(nodes, key=rank))
