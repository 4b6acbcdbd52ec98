"""A fake world for the supervisor: no process, no ROS, no waiting."""

import math
import signal
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from queue import Empty

from obelisk_spec.runtime_protocol import Rate, Standing
from obk_cli.launch.event_loop import Limits
from obk_cli.launch.events import (
    Answered,
    Ended,
    InputEvent,
    OutputEvent,
    Phase,
    ProcessEnded,
    ProcessStarted,
    RatesReported,
    Ready,
    StateAnswered,
    StateSeen,
)
from obk_cli.launch.process_groups import Unit, units_of
from obk_cli.launch.supervisor import Supervisor
from obk_cli.launch.transitions import Until
from obk_cli.plan.plan import OnCrash, Plan, PlannedNode
from obk_cli.runs.lifecycle import TRANSITIONS

from .. import plans  # noqa: TID252 - shared by folders of tests

ROBOT, ESTIMATOR, CONTROLLER = "/obelisk_robot_0", "/obelisk_estimation_0", "/obelisk_control_0"


def process(section: str, index: int = 0, device: str = "onboard") -> PlannedNode:
    return plans.node(f"obelisk_{section}_{index}", section, device=device)


def rates(node: str, measured_hz: float, standing: Standing = "kept") -> RatesReported:
    """A report of a node with one 100 Hz timer."""
    rate = Rate(
        name="timer",
        expected_hz=100.0,
        measured_hz=measured_hz,
        ticks=1,
        overruns=0,
        late_p50_us=10.0,
        late_p99_us=2500.0,
        late_max_us=3000.0,
        standing=standing,
    )
    return RatesReported(node=node, rates=(rate,))


PLAN = Plan(name="s", nodes=tuple(map(process, ("control", "estimation", "robot"))))


@dataclass
class World:
    """Processes, nodes, inbox and clock in one; behaves correctly unless set otherwise."""

    refuses: dict[tuple[str, str], str] = field(default_factory=dict)
    silent: set[tuple[str, str]] = field(default_factory=set)
    never_ready: set[str] = field(default_factory=set)
    found: dict[str, str] = field(default_factory=dict)
    """States of nodes that something else has changed before they are ready."""
    deaf_to: set[tuple[str, int]] = field(default_factory=set)
    unanswered: set[tuple[str, str]] = field(default_factory=set)
    """Transitions that are made, but whose responses are lost."""
    stale: StateSeen | None = None
    """A response that arrives when it is no longer true."""
    mute: set[str] = field(default_factory=set)
    """Nodes that do not even reply to requests for their state."""
    diagnostics: frozenset[str] = frozenset()
    """Nodes that publish `/diagnostics`."""
    plan: Plan = PLAN
    states: dict[str, str] = field(default_factory=dict)
    later: deque[InputEvent | float | Callable[[], None]] = field(default_factory=deque)
    """Events for when nothing else happens; a number is time that passes [s]."""
    dies_at_start: dict[str, int] = field(default_factory=dict)
    """How often a process ends immediately."""
    on_crash: OnCrash = "stop"
    together: frozenset[str] = frozenset()
    devices: frozenset[str] = frozenset({"onboard"})
    lead: str | None = None
    strict_rates: bool = False
    started: list[str] = field(default_factory=list)
    dumped: list[str] = field(default_factory=list)
    now: float = 0.0
    inbox: deque[InputEvent] = field(default_factory=deque)
    published: list[OutputEvent] = field(default_factory=list)
    done: list[tuple[str, str]] = field(default_factory=list)
    signals: list[tuple[str, int]] = field(default_factory=list)
    alive: set[str] = field(default_factory=set)

    def start(self, unit: Unit) -> None:
        self.started.append(unit.name)
        self.alive.add(unit.name)
        for node in unit.node_names:
            self.states.pop(node, None)
        if unit.name in self.dies_at_start and self.dies_at_start[unit.name] > 0:
            self.dies_at_start[unit.name] -= 1
            self.inbox.append(ProcessEnded(process=unit.name, code=1))
        else:
            self.inbox.append(ProcessStarted(process=unit.name, pid=1))

    def dump_stack(self, process: str) -> None:
        self.dumped.append(process)

    def last_lines(self, process: str) -> tuple[str, ...]:
        return (f"the last line of {process}",)

    def wait_for_output(self, processes: Iterable[str]) -> None:
        """All output is read at once."""

    def signal(self, process: str, number: int) -> None:
        self.signals.append((process, number))
        if (process, number) not in self.deaf_to:
            code = 0 if number == signal.SIGINT else -number
            if process in self.alive:
                self.alive.discard(process)
                self.inbox.append(ProcessEnded(process=process, code=code))

    def watch(self, nodes: Iterable[str]) -> None:
        self.inbox.extend(
            Ready(node=node, state=self.found.get(node, "unconfigured"))
            for node in nodes
            if node not in self.never_ready
        )

    def publishes_diagnostics(self, node: str) -> bool:
        return node in self.diagnostics

    def ask_state(self, node: str) -> None:
        if node not in self.mute:
            state = self.states.get(node, "unconfigured")
            self.inbox.append(StateAnswered(node=node, state=state))

    def request(self, node: str, transition: str) -> None:
        self.done.append((node, transition))
        if (node, transition) in self.silent:
            return
        fault = self.refuses.get((node, transition))
        if fault is None:
            self.states[node] = TRANSITIONS[transition].goal
        if (node, transition) in self.unanswered:
            return
        self.inbox.append(
            Answered(node=node, transition=transition, success=fault is None, fault=fault or "")
        )

    def get(self, *, timeout: float | None) -> InputEvent:
        if self.inbox:
            return self.inbox.popleft()
        if not self.later or isinstance(self.later[0], float):
            return self._wait(timeout)
        event = self.later.popleft()
        assert not isinstance(event, float)
        if callable(event):
            event()
            return self.get(timeout=timeout)
        if isinstance(event, StateSeen) and event != self.stale:
            self.states[event.node] = event.state
        if isinstance(event, ProcessEnded):
            self.alive.discard(event.process)
        return event

    def _wait(self, timeout: float | None) -> InputEvent:
        """Advance time to the next event or to the deadline."""
        assert timeout is not None or self.later, "nothing will ever happen again"
        assert self.now < 1e4, "the run never ends"
        left = self.later.popleft() if self.later else math.inf
        assert isinstance(left, float)
        if timeout is None or left <= timeout:
            self.now += left
            return self.get(timeout=None if timeout is None else timeout - left)
        self.now += timeout
        if left < math.inf:
            self.later.appendleft(left - timeout)
        raise Empty

    def run(self, until: Until = "active", duration_s: float | None = 5.0) -> Ended:
        supervisor = Supervisor(
            self.plan,
            units=units_of(self.plan, devices=self.devices, together=self.together),
            on_crash=self.on_crash,
            lead=self.lead,
            strict_rates=self.strict_rates,
            processes=self,
            lifecycle=self,
            inbox=self,
            clock=lambda: self.now,
            publish=self.published.append,
            limits=Limits(
                transition_s=10, start_s=20, grace_s=3, down_s=3, answer_s=2, hurry_s=0.5
            ),
        )
        return supervisor.run(until, duration_s)

    def of(self, kind: type[OutputEvent]) -> list[OutputEvent]:
        """The published events of one kind."""
        return [event for event in self.published if isinstance(event, kind)]

    def transitions_of(self, node: str) -> list[str]:
        """The requests to a node."""
        return [transition for name, transition in self.done if name == node]

    @property
    def phases(self) -> list[str]:
        """The names of the published phases."""
        return [event.name for event in self.published if isinstance(event, Phase)]
