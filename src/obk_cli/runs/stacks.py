"""The stacks that run on this host, and which of them and of their nodes a name means."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from obelisk_spec.components import TIERS
from obelisk_spec.suggestions import did_you_mean
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.runs.control_client import ANSWER_S, ask_status
from obk_cli.runs.folder import Run
from obk_cli.runs.protocol import NodeStatus, StackStatus
from obk_cli.runs.registry import live_folders

__all__ = [
    "NO_ANSWER",
    "Choice",
    "LiveStack",
    "choose_stack",
    "in_tier_order",
    "live_stacks",
    "node_statuses",
    "nodes_meant",
    "runs_meant",
    "section_of",
    "stack_nodes",
]

NO_ANSWER: Final = "no answer"
"""In place of a node's state."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveStack:
    """One launcher's stack, or its part of one."""

    folder: Path
    run: Run
    status: StackStatus | None
    """None: the launcher does not answer."""

    @property
    def life_cycle_nodes(self) -> tuple[NodeStatus, ...]:
        """Those that have states; none where the launcher does not answer."""
        return tuple(node for node in (self.status.nodes if self.status else ()) if node.state)


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """Nodes of one stack, and whom to ask for them."""

    stack: LiveStack
    nodes: tuple[str, ...]
    """Full names; empty: the whole stack."""


def live_stacks(runs: Mapping[Path, Run], timeout_s: float = ANSWER_S) -> tuple[LiveStack, ...]:
    """How the stacks of live runs are.

    Args:
        runs: by their folders.
        timeout_s: for each launcher's answer [s].
    """
    return tuple(
        LiveStack(folder=folder, run=run, status=ask_status(folder, timeout_s))
        for folder, run in runs.items()
    )


def runs_meant(
    parent: Path, name: str | None = None, *, domain: int | None = None
) -> Mapping[Path, Run]:
    """The live runs of this host that are meant, newest first.

    Args:
        parent: the folder of all runs.
        name: a config's name or a run folder's; None: all.
        domain: of a ROS domain only; None: of all.

    Raises:
        CommandFailedError: a name is given, and no live run has it.
    """
    live = live_folders(parent)
    here = {folder: run for folder, run in live.items() if domain in (None, run.domain)}
    if name is None:
        return here
    meant = {folder: run for folder, run in here.items() if name in (run.name, folder.name)}
    if not meant:
        where = "on this host" if domain is None else f"in the ROS domain {domain} on this host"
        names = sorted({run.name for run in here.values()})
        raise CommandFailedError(
            f"no stack `{name}` runs {where}", help=did_you_mean(name, names) or "see `obk ps`"
        )
    return meant


def node_statuses(
    stacks: Sequence[LiveStack], names: Sequence[str]
) -> Mapping[str, NodeStatus] | None:
    """The nodes that are meant, by full name; None where the launchers here cannot tell them all.

    Args:
        stacks: that run here.
        names: as a user gives them; none: all nodes.
    """
    if not names and not all(stack.status for stack in stacks):
        return None
    known: dict[str, NodeStatus] = {}
    for stack in stacks:
        for node in stack.life_cycle_nodes:
            # Of two launchers of one stack the one that runs the node knows it best.
            if node.node not in known or node.pid is not None:
                known[node.node] = node
    meant = [nodes_meant(name, known) for name in names] if names else [tuple(known)]
    if not all(meant):
        return None
    wanted = {node for nodes in meant for node in nodes}
    return {name: status for name, status in known.items() if name in wanted}


def choose_stack(stacks: Sequence[LiveStack], names: Sequence[str]) -> Choice | None:
    """Whom to ask for a transition of these nodes; None where no launcher here can be asked.

    Args:
        stacks: that run here.
        names: as a user gives them; none: the whole stack.

    Raises:
        MisuseError: nodes of more than one stack may be meant.
    """
    fitting = [choice for stack in stacks if (choice := _choice(stack, names)) is not None]
    stack_names = sorted({choice.stack.run.name for choice in fitting})
    if len(stack_names) > 1:
        raise MisuseError(
            f"several stacks run in the ROS domain {fitting[0].stack.run.domain}: "
            f"{', '.join(stack_names)}",
            help="choose one with `--run NAME`, or by its nodes' full names",
        )
    # Two launchers of one config: its devices. Whoever runs the nodes, else whoever leads.
    best = max(fitting, key=_fitness, default=None)
    return best if best and best.stack.status else None


def _choice(stack: LiveStack, names: Sequence[str]) -> Choice | None:
    if not names:
        return Choice(stack=stack, nodes=())
    known = [node.node for node in stack.life_cycle_nodes]
    meant = [nodes_meant(name, known) for name in names]
    if not all(meant):
        return None
    return Choice(stack=stack, nodes=tuple(_in_order_of(known, meant)))


def _in_order_of(known: Iterable[str], meant: Iterable[tuple[str, ...]]) -> Iterable[str]:
    wanted = {node for nodes in meant for node in nodes}
    return (node for node in known if node in wanted)


def _fitness(choice: Choice) -> tuple[bool, bool]:
    run = choice.stack.run
    return bool(choice.nodes) and set(choice.nodes) <= set(run.nodes), run.leads


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
