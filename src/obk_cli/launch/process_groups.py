"""Decide which nodes of a plan run here, and which of them share a process. Pure."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Final

from obk_cli.plan.plan import OnCrash, Plan, PlannedNode

__all__ = ["Share", "Unit", "devices_of", "rule_of", "share_of", "units_of"]

STRICTEST_FIRST: Final[tuple[OnCrash, ...]] = ("stop", "restart", "ignore")


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
    """The part of a stack that one launch runs."""

    devices: frozenset[str]
    """Devices whose nodes run here."""
    is_part: bool
    """Whether other launches run the nodes of other devices."""
    leads: bool = True
    """Whether this launch runs the transitions of the nodes of all devices."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """One process of the operating system and the nodes in it."""

    name: str
    """The node's full name; for nodes in one process, the stack's name with `composed`."""
    nodes: tuple[PlannedNode, ...]

    @property
    def node_names(self) -> tuple[str, ...]:
        """The nodes' full names."""
        return tuple(node.full_name for node in self.nodes)


def devices_of(plan: Plan) -> tuple[str, ...]:
    """The devices of a stack, in the order of the config."""
    return tuple(dict.fromkeys(node.device for node in plan.nodes))


def share_of(plan: Plan, device: str | None, lead: str | None = None) -> Share:
    """The part of one device, or the whole stack.

    Args:
        plan: the whole stack.
        device: one of its devices; None: all of them run here.
        lead: the device that leads; None: the first one with a controller, otherwise the first.
    """
    devices = devices_of(plan)
    if device is None or devices == (device,):
        return Share(devices=frozenset(devices), is_part=False)
    with_control = [node.device for node in plan.nodes if node.section == "control"]
    leader = lead or next(iter(with_control), devices[0])
    return Share(devices=frozenset({device}), is_part=True, leads=leader == device)


def units_of(
    plan: Plan, *, devices: Collection[str], together: Collection[str] = ()
) -> tuple[Unit, ...]:
    """The processes to start here, in the order of the plan.

    Args:
        plan: the whole stack.
        devices: the devices whose nodes run here.
        together: full names of the nodes that share a process.
    """
    here = [node for node in plan.nodes if node.device in devices]
    shared = tuple(node for node in here if node.full_name in together)
    alone = (node for node in here if node.full_name not in together)
    units = tuple(Unit(name=node.full_name, nodes=(node,)) for node in alone)
    return (*([Unit(name=f"/{plan.name}/composed", nodes=shared)] if shared else ()), *units)


def rule_of(nodes: Iterable[PlannedNode], on_crash: OnCrash) -> OnCrash:
    """The rule for a process that crashes: the strictest of its nodes' rules.

    Args:
        nodes: the nodes in the process.
        on_crash: for nodes whose config sets none.
    """
    return min((node.on_crash or on_crash for node in nodes), key=STRICTEST_FIRST.index)
