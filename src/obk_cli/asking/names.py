"""Which nodes and which runs a user means by a name. Pure."""

from collections.abc import Iterable
from typing import Final

from obelisk_spec.components import TIERS

__all__ = ["NO_ANSWER", "in_tier_order", "nodes_meant", "section_of", "stack_nodes"]

NO_ANSWER: Final = "no answer"
"""In place of a node's state."""


def nodes_meant(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """The nodes that a user means by a name, full or short (`control_0`), or by a section's."""
    every = tuple(known)
    if name in every:
        return (name,)
    tails = (f"/{name.lstrip('/')}", f"/obelisk_{name.lstrip('/')}")
    by_name = tuple(node for node in every if node.endswith(tails))
    return by_name or tuple(node for node in every if section_of(node) == name)


def stack_nodes(found: Iterable[str]) -> tuple[str, ...]:
    """Of life-cycle nodes in the ROS graph those of a stack, in tier order.

    A stack's nodes are named by their sections, its state node by its config; where nothing is
    named by a section, all are meant.
    """
    every = in_tier_order(found)
    return tuple(node for node in every if section_of(node)) or every


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
