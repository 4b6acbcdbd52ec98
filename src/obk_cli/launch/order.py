"""In which order nodes come up and down: tier by tier, robot first on the way up."""

from typing import Final, Literal

from obk_cli.launch.transitions import ACTIVE, INACTIVE, UNCONFIGURED
from obk_cli.plan.plan import Plan

__all__ = ["UNTIL", "Until", "tiers_down", "tiers_up"]

Until = Literal["none", "configured", "active"]
UNTIL: Final[dict[Until, str]] = {"none": UNCONFIGURED, "configured": INACTIVE, "active": ACTIVE}
"""How far a bring-up goes, and the state of the stack then."""


def tiers_up(plan: Plan) -> tuple[tuple[str, ...], ...]:
    """Full names by tier in the order in which they come up: the robot before controllers.

    Nodes without a life cycle make no transitions and are left out.
    """
    tiers = (tuple(p.full_name for p in tier if p.has_lifecycle) for tier in plan.tiers)
    return tuple(tier for tier in tiers if tier)


def tiers_down(plan: Plan) -> tuple[tuple[str, ...], ...]:
    """Full names by tier in the order in which they come down: controllers before the robot."""
    return tuple(reversed(tiers_up(plan)))
