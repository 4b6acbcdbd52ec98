"""What is known of every node and process of a run: facts only, nothing is done here."""

from collections import Counter
from collections.abc import Collection, Iterable
from typing import Final

from obelisk_spec.rates import Rate
from obk_cli.launch.asks import NodeStatus
from obk_cli.launch.events import ProcessEnded
from obk_cli.launch.transitions import ACTIVE, FINALIZED, INACTIVE, RESTING, UNCONFIGURED
from obk_cli.launch.units import Unit, rule_of
from obk_cli.plan.plan import OnCrash, Plan, Process

__all__ = ["GONE", "UNKNOWN", "Roster"]

UNKNOWN: Final = "unknown"
GONE: Final = "gone"
"""Instead of a state, for a node whose process has ended."""
ORDER: Final = (UNCONFIGURED, INACTIVE, ACTIVE)


class Roster:
    """The nodes of a plan, those of other devices too, and the processes that run here."""

    def __init__(
        self, plan: Plan, units: Iterable[Unit], *, leads: bool = True, on_crash: OnCrash = "stop"
    ) -> None:
        """Begin with nothing running.

        Args:
            plan: the whole stack.
            units: the processes that run here.
            leads: whether the nodes of other devices are taken through transitions from here too.
            on_crash: for nodes whose config does not say.
        """
        self.plan = plan
        self.units = {unit.name: unit for unit in units}
        self.unit_of = {node: unit.name for unit in self.units.values() for node in unit.node_names}
        self.nodes: dict[str, Process] = {p.full_name: p for p in plan.processes}
        self.with_lifecycle = {
            name
            for name, p in self.nodes.items()
            if p.has_lifecycle and (leads or name in self.unit_of)
        }
        """The nodes that are taken through transitions from here."""
        self.pids: dict[str, int] = {}
        self.running: set[str] = set()
        """Names of the units whose process is there, or was asked for."""
        self.ready: set[str] = set()
        self.states: dict[str, str] = {}
        self.wanted: dict[str, str] = {}
        """Where a node that crashed is to be brought back to."""
        self.lost: set[str] = set()
        """Nodes that crashed and that the stack goes on without."""
        self.failed: set[str] = set()
        """Nodes that failed by themselves and were left like that."""
        self.hung: set[str] = set()
        self.in_transition: set[str] = set()
        """Nodes that were asked for a transition and have not answered yet."""
        self.rates: dict[str, tuple[Rate, ...]] = {}
        """What nodes that are active said last of their promises."""
        self.restarts: Counter[str] = Counter()
        self.moving = ""
        """What a transition of the whole stack is called while it is under way."""
        self._on_crash: OnCrash = on_crash

    def is_here(self, node: str) -> bool:
        """Whether a node's process is one of this launch."""
        return node in self.unit_of

    def is_present(self, node: str) -> bool:
        """Whether a node can be asked for anything."""
        if not self.is_here(node):
            return node not in self.lost
        return self.unit_of[node] in self.running

    def here(self) -> set[str]:
        """The nodes with a life cycle whose processes are of this launch."""
        return {node for node in self.with_lifecycle if self.is_here(node)}

    def elsewhere(self) -> set[str]:
        """The nodes with a life cycle whose processes are of other launches."""
        return {
            name for name, p in self.nodes.items() if p.has_lifecycle and not self.is_here(name)
        }

    def counted(self) -> set[str]:
        """The nodes with a life cycle that make up the stack's state."""
        there = {n for n in self.with_lifecycle - self.lost if not self._hangs_ignored(n)}
        failed = {n for n in self.failed & there if self.states.get(n) == UNCONFIGURED}
        # Where the others are no further, nothing keeps it from coming along.
        is_behind = any(self.states.get(n) != UNCONFIGURED for n in there - failed)
        return there - failed if is_behind else there

    def _hangs_ignored(self, node: str) -> bool:
        """Whether the stack goes on without a node until that answers again."""
        return node in self.hung and self.on_crash(self.unit_of.get(node, node)) == "ignore"

    def on_crash(self, unit: str) -> OnCrash:
        """What is to be done when a process crashes."""
        return rule_of(self.members(unit), self._on_crash)

    def members(self, unit: str) -> tuple[Process, ...]:
        """The nodes in a process; a node of another device by its own name."""
        return self.units[unit].nodes if unit in self.units else (self.nodes[unit],)

    def starts(self, unit: str) -> None:
        """A process was asked for: nothing is known of its nodes any more."""
        self.running.add(unit)
        names = self.units[unit].node_names
        self.ready.difference_update(names)
        self.hung.difference_update(names)
        for node in names:
            self.states.pop(node, None)

    def ended(self, unit: str) -> None:
        """A process is gone."""
        self.running.discard(unit)
        self.pids.pop(unit, None)
        for node in self.units[unit].node_names:
            self.states[node] = GONE
            self.hung.discard(node)
            self.in_transition.discard(node)

    def culprit(self, ended: ProcessEnded) -> str:
        """The node that ended a process, as far as its last words tell; else the process."""
        names = self.units[ended.process].node_names
        return next((name for name in names if name in ended.text), ended.process)

    def origin_of_promise(self, node: str, name: str) -> str:
        """The place of a promised period, `file:line:column`; empty where the config has none."""
        places = (p.origin for p in self.nodes[node].promises if p.name == name)
        return str(next(places, ""))

    def is_resting(self, node: str) -> bool:
        """Whether a node is known to wait for a request, not to be in the middle of something."""
        return self.states.get(node) in RESTING

    def are_all(self, nodes: Collection[str], state: str) -> bool:
        """Whether there are nodes, and all of them are in a state."""
        return bool(nodes) and all(self.states.get(node) == state for node in nodes)

    def stack_state(self) -> str:
        """The furthest state that every node has reached, or the transition under way."""
        if self.moving:
            return self.moving
        counted = self.counted()
        if self.are_all(counted, FINALIZED):
            return FINALIZED
        states = {self.states.get(node, UNCONFIGURED) for node in counted}
        ranks = [ORDER.index(state) if state in ORDER else 0 for state in states]
        return ORDER[min(ranks, default=0)]

    def status(self) -> tuple[NodeStatus, ...]:
        """Every node, in the order of the plan."""
        return tuple(self._status(node) for node in self.plan.processes)

    def _status(self, node: Process) -> NodeStatus:
        name = node.full_name
        unit = self.unit_of.get(name, name)
        return NodeStatus(
            node=name,
            section=node.section,
            device=node.device,
            state=self.states.get(name, UNKNOWN) if node.has_lifecycle else "",
            process=unit,
            pid=self.pids.get(unit),
            restarts=self.restarts[unit],
            hangs=name in self.hung,
            rates=self.rates.get(name, ()) if self.states.get(name) == ACTIVE else (),
        )
