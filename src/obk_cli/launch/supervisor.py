"""Runs a plan: start, configure and activate in order, watch, bring down; nothing stays behind.

Hears from processes and nodes through one inbox, acts through two doors, tells what it does as
events. Knows no ROS, no operating system and no terminal; the clock is handed in.
"""

import signal
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from queue import Empty
from typing import Final, Protocol

from obk_cli.launch.events import (
    Answered,
    Ended,
    Failed,
    Heard,
    Phase,
    ProcessEnded,
    ProcessStarted,
    Ready,
    Result,
    StateAnswered,
    StateSeen,
    StopAsked,
    Told,
    TransitionEnded,
)
from obk_cli.launch.order import Step, Until, steps_up, tiers_down
from obk_cli.launch.transitions import (
    ACTIVE,
    FINALIZED,
    RESTING,
    TRANSITIONS,
    Transition,
    way_down,
)
from obk_cli.plan import Plan, Process

__all__ = ["Inbox", "Lifecycle", "Limits", "Processes", "Supervisor"]

EXIT_DONE: Final = 0
EXIT_FAILED: Final = 1
ONE_REQUEST_S: Final = 0.3
"""Signals this close to the first one belong to it: `timeout` sends two, a closing terminal too."""


class Inbox(Protocol):
    """What was heard, in order; a `queue.SimpleQueue` is one."""

    def get(self, *, timeout: float | None) -> Heard:
        """The next message; raises `queue.Empty` after `timeout` [s]."""


class Processes(Protocol):
    """The door to the operating system."""

    def start(self, process: Process) -> None:
        """Start a node's process; `ProcessStarted` or `ProcessEnded` follows."""

    def signal(self, node: str, number: int) -> None:
        """Send a signal to a node's process and all of its children."""


class Lifecycle(Protocol):
    """The door to the nodes."""

    def watch(self, nodes: Iterable[str]) -> None:
        """Begin to listen for these nodes; `Ready` follows for each."""

    def request(self, node: str, transition: str) -> None:
        """Ask a node for a transition; `Answered` follows."""

    def ask_state(self, node: str) -> None:
        """Ask a node for its state; `StateAnswered` follows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """How long things may take [s]."""

    transition_s: float = 10.0
    start_s: float = 20.0
    grace_s: float = 3.0
    """Between two signals, each harder than the one before."""
    down_s: float = 3.0
    """For one transition on the way down."""
    answer_s: float = 2.0
    """For the answer to a question."""
    hurry_s: float = 0.5
    """Instead of `grace_s` once the stop was asked for a second time."""


class Supervisor:
    """One run of one plan."""

    def __init__(
        self,
        plan: Plan,
        *,
        processes: Processes,
        lifecycle: Lifecycle,
        inbox: Inbox,
        clock: Callable[[], float],
        tell: Callable[[Told], None],
        limits: Limits | None = None,
    ) -> None:
        """Make a supervisor; `run` does everything.

        Args:
            plan: what to run.
            processes: starts and signals processes.
            lifecycle: asks nodes for transitions.
            inbox: where both doors, and signals, put what they hear.
            clock: monotonic time [s].
            tell: takes what happens.
            limits: deadlines.
        """
        self._plan = plan
        self._processes = processes
        self._lifecycle = lifecycle
        self._inbox = inbox
        self._clock = clock
        self._tell = tell
        self._limits = limits or Limits()
        self._begin = clock()
        self._with_lifecycle = {p.full_name for p in plan.processes if p.has_lifecycle}
        self._running: set[str] = set()
        self._ready: set[str] = set()
        self._states: dict[str, str] = {}
        self._echoes: Counter[tuple[str, str]] = Counter()
        """Transitions asked for here (node, name) of which the node has not told by itself yet."""
        self._left: set[str] = set()
        """Nodes that were left in the middle of a transition when the stop was asked for."""
        self._silent: set[str] = set()
        """Nodes that gave no answer on the way down; nothing more is asked of them."""
        self._stop: str | None = None
        self._failures: list[str] = []
        self._stopping_since: float | None = None
        self._is_going_down = False
        self._is_in_a_hurry = False

    def run(self, until: Until = "active", duration_s: float | None = None) -> Ended:
        """Bring the stack up, watch it, bring it down.

        Args:
            until: how far the bring-up goes.
            duration_s: how long the stack runs after the bring-up [s]; None: until asked to stop.
        """
        if self._bring_up(until):
            deadline = None if duration_s is None else self._clock() + duration_s
            while self._may_go_on and self._hear(deadline):
                pass
            if self._may_go_on:
                self._stop = f"{duration_s:g} s are over"
        self._bring_down()
        ended = Ended(
            exit_code=EXIT_FAILED if self._failures else EXIT_DONE,
            cause=self._failures[0] if self._failures else "",
            consequences=max(0, len(self._failures) - 1),
        )
        self._tell(ended)
        return ended

    @property
    def _may_go_on(self) -> bool:
        return self._stop is None and not self._failures

    def _phase(self, name: str, detail: str = "") -> None:
        self._tell(Phase(name=name, seconds=self._clock() - self._begin, detail=detail))

    def _bring_up(self, until: Until) -> bool:
        names = self._with_lifecycle
        self._phase("starting", f"{len(self._plan.processes)} nodes")
        for process in self._plan.processes:
            self._processes.start(process)
            self._running.add(process.full_name)
        deadline = self._clock() + self._limits.start_s
        while self._may_go_on and self._ready != names:
            if not self._hear(deadline):
                late = ", ".join(sorted(names - self._ready))
                self._fail(f"no life-cycle services after {self._limits.start_s:g} s: {late}")
        if not self._may_go_on:
            return False
        self._phase("ready")
        for step in steps_up(self._plan, until):
            if not self._make(step):
                return False
        self._phase({"none": "started", "configured": "configured", "active": "active"}[until])
        return True

    def _make(self, step: Step) -> bool:
        """Take the nodes of a step through its transition; on failure take them back."""
        results = self._transition(step.transition, step.nodes, self._limits.transition_s)
        if all(result == "reached" for result in results.values()) and self._may_go_on:
            return True
        reached = tuple(node for node, result in results.items() if result == "reached")
        if reached and self._failures and step.transition.undo:
            undo = TRANSITIONS[step.transition.undo]
            self._phase("rolling back", ", ".join(reached))
            self._transition(undo, reached, self._limits.transition_s)
        return False

    def _transition(
        self, transition: Transition, nodes: Iterable[str], limit_s: float
    ) -> dict[str, Result]:
        """Ask all nodes at once and wait for every answer, at most `limit_s`."""
        asked = self._clock()
        waiting = set(nodes) & self._running
        results: dict[str, Result] = dict.fromkeys(nodes, "gone")
        for node in sorted(waiting):
            self._echoes[node, transition.name] += 1
            self._lifecycle.request(node, transition.name)
        while waiting and not self._must_leave and (heard := self._hear(asked + limit_s)):
            if isinstance(heard, Answered) and heard.transition == transition.name:
                waiting.discard(heard.node)
                results[heard.node] = "reached" if heard.success else "refused"
                self._concluded(heard.node, transition, results[heard.node], asked, heard.fault)
            waiting &= self._running
        if self._must_leave:
            self._left |= waiting
            return results
        for node in sorted(waiting):
            results[node] = "timed out"
            if self._is_going_down:
                self._silent.add(node)
            self._concluded(node, transition, "timed out", asked, "")
        return results

    @property
    def _must_leave(self) -> bool:
        """Whether nothing is to be waited for any more: the stop was asked for, down: twice."""
        return self._is_in_a_hurry if self._is_going_down else self._stop is not None

    def _concluded(
        self, node: str, transition: Transition, result: Result, asked: float, fault: str
    ) -> None:
        seconds = self._clock() - asked
        self._tell(
            TransitionEnded(
                node=node, transition=transition.name, result=result, seconds=seconds, fault=fault
            )
        )
        if result == "reached":
            self._states[node] = transition.goal
        elif not (result == "refused" and self._is_lost(node)):
            how = f"was not done within {seconds:.1f} s" if result == "timed out" else "failed"
            first = f": {fault.splitlines()[0]}" if fault else ""
            self._fail(f"{node}: the transition '{transition.name}' {how}{first}")

    def _bring_down(self) -> None:
        self._is_going_down = True
        if self._stopping_since is None:
            self._stopping_since = self._clock()
        self._phase("stopping", self._failures[0] if self._failures else self._stop or "")
        for tier in tiers_down(self._plan):
            self._take_down(tier)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            self._signal_all(number)
        for node in sorted(self._running):
            self._fail(f"{node}: the process is still there after SIGKILL")
        self._phase("stopped")

    def _take_down(self, nodes: Iterable[str]) -> None:
        self._ask_states(nodes)
        for transition in way_down(ACTIVE):
            if self._is_in_a_hurry:
                return
            at = [
                node
                for node in nodes
                if node in self._ready - self._silent
                and (self._is_lost(node) or self._states[node] in transition.starts)
            ]
            self._transition(transition, at, self._limits.down_s)

    def _ask_states(self, nodes: Iterable[str]) -> None:
        """Learn where nodes are, from themselves: the way up may have been left anywhere."""
        waiting = set(nodes) & self._ready & self._running
        for node in sorted(waiting):
            self._lifecycle.ask_state(node)
        deadline = self._clock() + self._limits.answer_s
        while waiting and not self._is_in_a_hurry and (heard := self._hear(deadline)):
            if isinstance(heard, StateAnswered):
                waiting.discard(heard.node)
                self._states[heard.node] = heard.state
            waiting &= self._running
        self._silent |= waiting
        for node in sorted(waiting - self._left):
            if not self._is_in_a_hurry:
                self._fail(f"{node}: does not tell its state within {self._limits.answer_s:g} s")

    def _is_lost(self, node: str) -> bool:
        """Whether a node that is to come down was in the middle of something when last asked.

        It is asked for everything in turn, and what it refuses is no failure.
        """
        return self._is_going_down and self._states.get(node) not in RESTING

    def _signal_all(self, number: int) -> None:
        """Send a signal to what still runs, and wait for the ends."""
        for node in sorted(self._running):
            # Before it is ready a node does not handle SIGINT yet, Python does: with a traceback
            # that says nothing.
            early = number == signal.SIGINT and self._is_early(node)
            self._processes.signal(node, signal.SIGTERM if early else number)
        begin = self._clock()
        while self._running:
            is_short = self._is_in_a_hurry and number != signal.SIGKILL
            grace_s = self._limits.hurry_s if is_short else self._limits.grace_s
            if self._hear(begin + grace_s) is None:
                return

    def _hear(self, deadline: float | None) -> Heard | None:
        """The next message, after taking note of it; None at the deadline."""
        try:
            left = None if deadline is None else max(0.0, deadline - self._clock())
            heard = self._inbox.get(timeout=left)
        except Empty:
            return None
        match heard:
            case ProcessStarted(node=node):
                self._tell(heard)
                # Not before: a node of the same name might be there that is not ours.
                self._lifecycle.watch({node} & self._with_lifecycle)
            case Ready(node=node):
                self._ready.add(node)
            case StateSeen():
                self._seen(heard)
            case Failed():
                self._failed(heard)
            case StopAsked():
                self._stop_asked(heard)
            case ProcessEnded():
                self._ended(heard)
            case _:
                pass
        return heard

    def _seen(self, heard: StateSeen) -> None:
        """A node's state changed: by what was asked here, or from elsewhere."""
        if self._is_echo(heard) or self._is_going_down:
            return
        self._states[heard.node] = heard.state
        self._tell(heard)
        nodes = self._running & self._with_lifecycle
        if all(self._states.get(node) == FINALIZED for node in nodes):
            self._stop = self._stop or "every node was shut down from elsewhere"

    def _failed(self, heard: Failed) -> None:
        """A fault of the node's own takes the stack down; a transition's is whose who asked."""
        if self._is_echo(heard) or self._is_going_down:
            return
        self._tell(heard)
        if not heard.transition:
            first = heard.fault.splitlines()[0] if heard.fault else "no reason given"
            self._fail(f"{heard.node} failed: {first}")

    def _is_echo(self, heard: StateSeen | Failed) -> bool:
        """Whether a node tells of what was asked here; the answer, on another way, is what counts.

        Both may come in either order, so an old message must not stand for the newest state.
        """
        transition = (heard.node, heard.transition)
        if self._echoes[transition] == 0:
            return False
        self._echoes[transition] -= 1
        return True

    def _stop_asked(self, heard: StopAsked) -> None:
        """Stop; asked again, and not just by one who sends two signals at once, hurry."""
        if self._stopping_since is None:
            self._stopping_since = self._clock()
        elif heard.is_urgent and self._clock() - self._stopping_since > ONE_REQUEST_S:
            self._is_in_a_hurry = True
        self._stop = self._stop or heard.reason

    def _ended(self, heard: ProcessEnded) -> None:
        self._running.discard(heard.node)
        self._states[heard.node] = FINALIZED
        ends = {-signal.SIGTERM} if self._is_early(heard.node) else set()
        if heard.node not in self._with_lifecycle:
            ends = {-signal.SIGINT, -signal.SIGTERM}
        in_order = heard.code == 0 or heard.code in ends
        if not (self._is_going_down and in_order):
            self._tell(heard)
            self._fail(f"{heard.node}: {heard.how}")

    def _is_early(self, node: str) -> bool:
        return node in self._with_lifecycle - self._ready

    def _fail(self, text: str) -> None:
        self._failures.append(text)
