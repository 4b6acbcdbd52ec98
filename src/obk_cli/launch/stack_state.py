"""Facts about a run: its nodes, its processes and the failures so far. Makes no decisions.

`StackState` holds the nodes; `RunState` holds why and how fast the run is to end.
"""

from collections import Counter, deque
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Final, Literal

from obelisk_spec.runtime_protocol import Rate
from obk_cli.launch.process_groups import Unit, rule_of
from obk_cli.launch.transitions import UNKNOWN
from obk_cli.plan.plan import OnCrash, Plan, PlannedNode
from obk_cli.runs.lifecycle import ACTIVE, FINALIZED, INACTIVE, RESTING, UNCONFIGURED
from obk_cli.runs.protocol import NodeStatus

__all__ = ["GONE", "Crash", "RunState", "StackState"]

GONE: Final = "gone"
"""Shown instead of a state for a node whose process has ended."""
ORDER: Final = (UNCONFIGURED, INACTIVE, ACTIVE)
ONE_REQUEST_S: Final = 0.3
"""Signals within this time are one request: `timeout` and closing terminals send several [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Crash:
    """A crash to which the `on_crash` rule applies and that is not handled yet."""

    unit: str
    kind: Literal["ended", "hung", "fault"]
    text: str
    node: str
    """The node at fault; the unit if its process ended or hangs and the node is unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """Why the stack comes down."""

    text: str
    node: str | None = None


class RunState:
    """Whether a run may go on, and how fast it ends."""

    def __init__(self) -> None:
        self._failures: list[Failure] = []
        self._stop_reason: str | None = None
        self._stopping_since: float | None = None
        self._is_going_down = False
        self._force_quit = False

    @property
    def may_go_on(self) -> bool:
        """Whether nothing requires the stack to come down."""
        return self._stop_reason is None and not self._failures

    @property
    def is_going_down(self) -> bool:
        """Whether the stack is being brought down; processes are expected to end then."""
        return self._is_going_down

    @property
    def force_quit(self) -> bool:
        """Whether the stop was requested again, so that nothing waits any more."""
        return self._force_quit

    @property
    def must_leave(self) -> bool:
        """Whether to stop waiting for a transition."""
        return self._force_quit if self._is_going_down else not self.may_go_on

    @property
    def failures(self) -> tuple[Failure, ...]:
        """The failures so far, the first cause first."""
        return tuple(self._failures)

    @property
    def stop_reason(self) -> str | None:
        """Why the stack comes down without a failure; None if it does not."""
        return self._stop_reason

    @property
    def reason(self) -> str:
        """Why the stack comes down; empty if nothing has ended the run."""
        return self._failures[0].text if self._failures else self._stop_reason or ""

    def fail(self, text: str, node: str | None = None) -> None:
        """Bring the stack down for a failure."""
        self._failures.append(Failure(text=text, node=node))

    def stop(self, reason: str) -> None:
        """Bring the stack down without a failure; the first reason is kept."""
        self._stop_reason = self._stop_reason or reason

    def request_stop(self, reason: str, now: float, *, is_urgent: bool) -> None:
        """Stop on request; a later urgent request outside the same burst forces the stop."""
        if self._stopping_since is None:
            self._stopping_since = now
        elif is_urgent and now - self._stopping_since > ONE_REQUEST_S:
            self._force_quit = True
        self.stop(reason)

    def go_down(self, now: float) -> None:
        """Start to bring the stack down."""
        self._is_going_down = True
        if self._stopping_since is None:
            self._stopping_since = now


class StackState:
    """The nodes of a plan, including those on other devices, and the processes that run here."""

    def __init__(
        self, plan: Plan, units: Iterable[Unit], *, lead: str | None, on_crash: OnCrash
    ) -> None:
        """Start without running processes.

        Args:
            plan: the whole stack.
            units: the processes that run here.
            lead: full name of the state node of the launch that runs the nodes' transitions; None:
                this launch does, also for other devices.
            on_crash: for nodes whose config sets none.
        """
        self.plan: Final = plan
        self.lead: Final = lead
        self.units: Final = {unit.name: unit for unit in units}
        self.unit_of: Final = {
            node: unit.name for unit in self.units.values() for node in unit.node_names
        }
        self.nodes: Final[dict[str, PlannedNode]] = {p.full_name: p for p in plan.nodes}
        self.with_lifecycle: Final = frozenset(
            name
            for name, p in self.nodes.items()
            if p.has_lifecycle and (lead is None or name in self.unit_of)
        )
        """The nodes whose transitions this launch runs."""
        self.pids: Final[dict[str, int]] = {}
        self.running: Final[set[str]] = set()
        """Names of the units whose process is running or was requested."""
        self.ready: Final[set[str]] = set()
        self.states: Final[dict[str, str]] = {}
        self.requested: Final[dict[str, str]] = {}
        """The last state requested of a node, to which it is restored after a crash."""
        self.lost: Final[set[str]] = set()
        """Nodes that crashed and without which the stack continues."""
        self.failed: Final[set[str]] = set()
        """Nodes that failed by themselves and were left in that state."""
        self.hung: Final[set[str]] = set()
        self.in_transition: Final[set[str]] = set()
        """Nodes that have not yet answered a requested transition."""
        self.rates: Final[dict[str, tuple[Rate, ...]]] = {}
        """The last reported rates of active nodes."""
        self.pages: Final[dict[str, str]] = {}
        """The URLs of the pages that show simulated robots; empty if a page has gone."""
        self.restarts: Final[Counter[str]] = Counter()
        self.crashes: Final[deque[Crash]] = deque()
        """Crashes that are not handled yet."""
        self.moving = ""
        """The state shown for the whole stack during a transition; empty: that of its nodes."""
        self._on_crash: OnCrash = on_crash

    def is_local(self, node: str) -> bool:
        """Whether this launch runs a node's process."""
        return node in self.unit_of

    def is_present(self, node: str) -> bool:
        """Whether a node can take requests."""
        if not self.is_local(node):
            return node not in self.lost
        return self.unit_of[node] in self.running

    def is_early(self, unit: str) -> bool:
        """Whether a process's nodes do not handle signals themselves yet."""
        names = self.with_lifecycle.intersection(self.units[unit].node_names)
        return not names <= self.ready

    def local_nodes(self) -> frozenset[str]:
        """The nodes with a lifecycle whose processes this launch runs."""
        return frozenset(node for node in self.with_lifecycle if self.is_local(node))

    def remote_nodes(self) -> frozenset[str]:
        """The nodes with a lifecycle whose processes other launches run."""
        return frozenset(
            name for name, p in self.nodes.items() if p.has_lifecycle and not self.is_local(name)
        )

    def missing(self, nodes: Collection[str]) -> frozenset[str]:
        """The nodes that have yet to come up."""
        return frozenset(nodes) - self.ready - self.lost

    def counted(self) -> frozenset[str]:
        """The nodes with a lifecycle that determine the stack's state."""
        present = {n for n in self.with_lifecycle - self.lost if not self._hangs_ignored(n)}
        failed = {n for n in self.failed & present if self.states.get(n) == UNCONFIGURED}
        # Unless another node is further along, a failed node can still come up with the rest.
        is_behind = any(self.states.get(n) != UNCONFIGURED for n in present - failed)
        return frozenset(present - failed if is_behind else present)

    def _hangs_ignored(self, node: str) -> bool:
        """Whether the stack continues without a hung node until it answers again."""
        return node in self.hung and self.on_crash(self.unit_of.get(node, node)) == "ignore"

    def on_crash(self, unit: str) -> OnCrash:
        """The rule for a process that crashes."""
        return rule_of(self.members(unit), self._on_crash)

    def housemates(self, node: str) -> tuple[str, ...]:
        """The nodes in a node's process, with itself; for a node of another device, itself."""
        return self.units[self.unit_of[node]].node_names if node in self.unit_of else (node,)

    def members(self, unit: str) -> tuple[PlannedNode, ...]:
        """The nodes in a process; for a node of another device, by its own name."""
        return self.units[unit].nodes if unit in self.units else (self.nodes[unit],)

    def process_requested(self, unit: str) -> None:
        """Forget everything known about the nodes of a process that is about to start."""
        self.running.add(unit)
        names = self.units[unit].node_names
        self.ready.difference_update(names)
        self.hung.difference_update(names)
        for node in names:
            self.states.pop(node, None)

    def process_ended(self, unit: str) -> None:
        """Record that a process and its nodes have ended."""
        self.running.discard(unit)
        self.pids.pop(unit, None)
        for node in self.units[unit].node_names:
            self.states[node] = GONE
            self.pages.pop(node, None)
            self.hung.discard(node)
            self.in_transition.discard(node)

    def forget_crashes(self, unit: str) -> None:
        """Drop the crashes of a process that is handled as a whole."""
        kept = [crash for crash in self.crashes if crash.unit != unit]
        self.crashes.clear()
        self.crashes.extend(kept)

    def culprit(self, unit: str, last_words: str) -> str:
        """The node that made a process exit, if its last line starts with one; otherwise the unit.

        That line is `/node: cause` if the process of several nodes ends for a fault in one of them.
        """
        names = self.units[unit].node_names
        return next((name for name in names if last_words.startswith(f"{name}: ")), unit)

    def origin_of_rate(self, node: str, name: str) -> str:
        """Location of an expected period, `file:line:column`; empty if the config has none."""
        places = (p.origin for p in self.nodes[node].rates if p.name == name)
        return str(next(places, ""))

    def is_resting(self, node: str) -> bool:
        """Whether a node is known not to be in a transition."""
        return self.states.get(node) in RESTING

    def are_finalized(self, nodes: Collection[str]) -> bool:
        """Whether `nodes` is not empty and all are finalized."""
        return bool(nodes) and all(self.states.get(node) == FINALIZED for node in nodes)

    def summary(self) -> str:
        """The furthest state that every node has reached, or the current transition."""
        if self.moving:
            return self.moving
        counted = self.counted()
        if self.are_finalized(counted):
            return FINALIZED
        states = {self.states.get(node, UNCONFIGURED) for node in counted}
        ranks = [ORDER.index(state) if state in ORDER else 0 for state in states]
        return ORDER[min(ranks, default=0)]

    def status(self) -> tuple[NodeStatus, ...]:
        """The status of every node, in the order of the plan."""
        return tuple(self._status(node) for node in self.plan.nodes)

    def _status(self, node: PlannedNode) -> NodeStatus:
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
            page=self.pages.get(name, ""),
        )
