"""Which nodes share a process, and by which rule: each one alone, or those of a composed stack."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Final

from obk_cli.plan.plan import OnCrash, Plan, Process

__all__ = ["Unit", "rule_of", "units_of"]

STRICTEST_FIRST: Final[tuple[OnCrash, ...]] = ("stop", "restart", "ignore")


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """One process of the operating system and the nodes in it."""

    name: str
    """The node's full name; of nodes together, the stack's with `composed`."""
    nodes: tuple[Process, ...]

    @property
    def node_names(self) -> tuple[str, ...]:
        """The nodes' full names."""
        return tuple(node.full_name for node in self.nodes)


def units_of(
    plan: Plan, *, devices: Collection[str], together: Collection[str] = ()
) -> tuple[Unit, ...]:
    """The processes to start here, in the order of the plan.

    Args:
        plan: the whole stack.
        devices: those whose nodes run here.
        together: full names of the nodes that share one process.
    """
    here = [node for node in plan.processes if node.device in devices]
    shared = tuple(node for node in here if node.full_name in together)
    alone = (node for node in here if node.full_name not in together)
    units = tuple(Unit(name=node.full_name, nodes=(node,)) for node in alone)
    return (*([Unit(name=f"/{plan.name}/composed", nodes=shared)] if shared else ()), *units)


def rule_of(nodes: Iterable[Process], on_crash: OnCrash) -> OnCrash:
    """What is to be done when a process crashes: the strictest wish of the nodes in it.

    Args:
        nodes: those in the process.
        on_crash: for nodes whose config does not say.
    """
    return min((node.on_crash or on_crash for node in nodes), key=STRICTEST_FIRST.index)
