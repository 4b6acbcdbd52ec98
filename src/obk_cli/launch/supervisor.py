"""Supervises one run of a plan: brings the stack up, watches it, brings it down.

The supervisor owns the state of the run. It receives input events through one inbox, acts through
two interfaces and publishes output events. It does not depend on ROS, the operating system or a
terminal; its clock is passed in.
"""

import signal
from collections import deque
from collections.abc import Callable, Collection, Iterable
from typing import Final

from obelisk_spec.runtime_protocol import rejection_text
from obk_cli.errors import EXIT_DONE, EXIT_FAILED
from obk_cli.launch.event_loop import EventLoop, Inbox, Lifecycle, Limits, Processes, RunContext
from obk_cli.launch.events import (
    FAULT_TRANSITIONS,
    SIGNAL_EXIT,
    UNKNOWN_FAULT,
    ActivationReported,
    Answered,
    AnswersAgain,
    ChangeRequested,
    Ended,
    EventPublisher,
    Failed,
    Hung,
    InputEvent,
    OutputEvent,
    PageReported,
    ProcessEnded,
    ProcessStarted,
    RateBroken,
    RatesReported,
    RatesUnreported,
    Ready,
    RejectionReported,
    StateAnswered,
    StateSeen,
    StatusRequested,
    StopRequested,
    TransitionEnded,
    TransitionStarted,
    UnknownPublisherFound,
    VideoReported,
    WaitingFor,
)
from obk_cli.launch.heartbeat import AwakeClock, Heartbeat
from obk_cli.launch.process_groups import Unit
from obk_cli.launch.processes import ProcessControl
from obk_cli.launch.rates import RateWatch
from obk_cli.launch.restart_policy import RestartPolicy
from obk_cli.launch.stack_state import RunState, StackState
from obk_cli.launch.transition_runner import Change, TransitionRunner, reason
from obk_cli.launch.transitions import UNTIL, WAY_DOWN, PendingRequests, Until, tiers_down, way_up
from obk_cli.plan.plan import OnCrash, Plan
from obk_cli.runs.lifecycle import ACTIVE, FINALIZED, TRANSITIONS, UNCONFIGURED, Transition
from obk_cli.runs.protocol import ChangeAnswer, Member

__all__ = ["Supervisor"]

REMINDER_S: Final = 5.0
"""Time between two messages about the nodes that the bring-up is waiting for [s]."""
REACHED: Final[dict[Until, str]] = {
    "none": "started",
    "configured": "configured",
    "active": "active",
}
NOT_BY_US: Final = "every node was shut down, but not by this launch"


class Supervisor:
    """One run of a plan, or of this machine's part of it."""

    def __init__(
        self,
        plan: Plan,
        *,
        units: Iterable[Unit],
        processes: Processes,
        lifecycle: Lifecycle,
        inbox: Inbox,
        clock: Callable[[], float],
        publish: Callable[[OutputEvent], None],
        limits: Limits | None = None,
        on_crash: OnCrash = "stop",
        lead: str | None = None,
        strict_rates: bool = False,
    ) -> None:
        """Create a supervisor; `run` does everything.

        Args:
            plan: the whole stack.
            units: the processes that run here. The plan's other nodes run on other devices.
            processes: starts and signals processes.
            lifecycle: requests transitions from nodes.
            inbox: receives events from both interfaces, from signals and from other terminals.
            clock: monotonic time [s].
            publish: receives the output events.
            limits: time limits.
            on_crash: for nodes whose config sets none.
            lead: full name of the state node of the leading launch, which runs the transitions of
                all nodes on all devices; None if this launch leads.
            strict_rates: whether the stack stops if an expected rate is missed.
        """
        limits = limits or Limits()
        awake = AwakeClock(clock)
        state = StackState(plan, units, lead=lead, on_crash=on_crash)
        heartbeat = Heartbeat(limits.hang_s)
        loop = EventLoop(
            inbox=inbox,
            clock=awake,
            heartbeat=heartbeat,
            dispatch=self._dispatch,
            check=self._check_nodes,
        )
        self._context = RunContext(
            state=state,
            run=RunState(),
            loop=loop,
            publisher=EventPublisher(state, awake, publish),
            pending=PendingRequests(),
            heartbeat=heartbeat,
            processes=processes,
            lifecycle=lifecycle,
            limits=limits,
        )
        self._state, self._run = state, self._context.run
        self._control = ProcessControl(self._context)
        self._runner = TransitionRunner(self._context, self._control)
        self._restarts = RestartPolicy(self._context, self._control, self._runner)
        self._rates = RateWatch(state, lifecycle.publishes_diagnostics)
        self._strict_rates = strict_rates
        self._rejections: dict[str, RejectionReported] = {}
        """Node -> its last report, for robots that reject all commands."""
        self._changes: deque[ChangeRequested] = deque()
        """Changes waiting to be made."""
        self._busy_with = ""
        """Why no change can be made now, phrased to follow "the stack is"; empty if changes are
        possible."""

    def run(self, until: Until = "active", duration_s: float | None = None) -> Ended:
        """Bring the stack up, watch it, bring it down.

        Args:
            until: how far the bring-up goes.
            duration_s: how long the stack runs after the bring-up [s]; None: until a stop request.
        """
        self._busy_with = "being brought up"
        if self._bring_up(until):
            self._keep_up(None if duration_s is None else self._context.loop.now() + duration_s)
            if self._run.may_go_on:
                self._run.stop(f"after {duration_s:g} s")
        self._bring_down()
        if not self._run.failures:
            self._judge_rejections()
        ended = self._ended()
        self._context.publisher.publish(ended)
        return ended

    def _judge_rejections(self) -> None:
        for node, rejection in sorted(self._rejections.items()):
            self._run.fail(rejection_text(node, rejection.seconds, rejection.reason), node)

    def _ended(self) -> Ended:
        failures = self._run.failures
        if not failures:
            return Ended(exit_code=EXIT_DONE, cause="")
        node = self._state.nodes.get(failures[0].node or "")
        return Ended(
            exit_code=EXIT_FAILED,
            cause=failures[0].text,
            consequences=len(failures) - 1,
            origin=str(node.origin) if node else "",
        )

    # --- bring-up ---

    def _bring_up(self, until: Until) -> bool:
        context, state = self._context, self._state
        count = len(state.units)
        context.publisher.phase("starting", f"{count} process{'es' if count > 1 else ''}")
        for unit in state.units:
            self._control.start(unit)
        if not self._wait_for_own() or not self._wait_for_others():
            return False
        context.publisher.phase("ready")
        if state.lead is not None:
            context.lifecycle.watch(state.remote_nodes())
            context.publisher.phase("following", state.lead)
            return True
        if not all(self._take_all_through(transition) for transition in way_up(UNTIL[until])):
            return False
        context.publisher.phase(REACHED[until])
        return True

    def _wait_for_own(self) -> bool:
        """Wait until every node on this machine is ready or lost."""
        context, state = self._context, self._state
        deadline = context.loop.now() + context.limits.start_s
        while self._run.may_go_on and (late := state.missing(state.local_nodes())):
            if state.crashes:
                self._restarts.handle_crashes()
            elif context.loop.wait(deadline) is None:
                names = ", ".join(sorted(late))
                limit_s = context.limits.start_s
                for node in sorted(late):
                    self._control.report_evidence(node)
                self._run.fail(f"no lifecycle services after {limit_s:g} s: {names}", min(late))
        return self._run.may_go_on

    def _wait_for_others(self) -> bool:
        """Wait until the nodes on other devices are ready; no limit, because users start them."""
        context, state = self._context, self._state
        others = state.with_lifecycle - state.local_nodes()
        context.lifecycle.watch(others)
        reminder = context.loop.now()
        while self._run.may_go_on and (late := state.missing(others)):
            if state.crashes:
                self._restarts.handle_crashes()
            elif context.loop.wait(reminder) is None:
                devices = dict.fromkeys(state.nodes[node].device for node in sorted(late))
                nodes = tuple(sorted(late))
                context.publisher.publish(WaitingFor(devices=tuple(devices), nodes=nodes))
                reminder = context.loop.now() + REMINDER_S
        silent = self._runner.learn_states(others) if self._run.may_go_on else frozenset()
        for node in sorted(silent):
            self._run.fail(f"{node}: did not report its state", node)
        return self._run.may_go_on

    def _take_all_through(self, transition: Transition) -> bool:
        """Take every node through a transition; nodes that crash in the meantime are restored."""
        limit_s = self._context.limits.transition_s
        while self._run.may_go_on:
            change = Change(transition=transition, nodes=self._state.counted(), limit_s=limit_s)
            answer = self._runner.run(change)
            if answer.success:
                # A node may have crashed after the transition.
                self._restarts.handle_crashes()
                return self._run.may_go_on
            # A node whose code has already failed rejects the transition; treat it like any other
            # crashed node.
            crashed = {crash.node for crash in self._state.crashes}
            culprits = [
                member
                for member in answer.members
                if member.is_culprit and member.result != "gone" and member.node not in crashed
            ]
            for member in culprits:
                self._run.fail(reason(member, transition, limit_s), member.node)
            if not culprits and not self._state.crashes and self._run.may_go_on:
                self._run.fail(answer.why)
            self._restarts.handle_crashes()
        return False

    # --- while the stack is up ---

    def _keep_up(self, until: float | None) -> None:
        """Handle crashes and requested changes until the run ends, or until a given time."""
        state, lead = self._state, self._state.lead
        self._watch(node for node in state.with_lifecycle if state.is_present(node))
        if lead is not None:
            self._context.lifecycle.watch({lead})
        idle = "" if lead is None else "controlled by the launch on another device"
        while self._run.may_go_on:
            if state.crashes:
                self._busy_with = "restarting a node that crashed"
                self._restarts.handle_crashes()
            elif self._changes:
                self._busy_with = "busy with another change"
                change = self._changes.popleft()
                change.reply(self._change(change))
            else:
                self._busy_with = idle
                if self._context.loop.wait(until) is None:
                    return

    def _change(self, requested: ChangeRequested) -> ChangeAnswer:
        """Make a requested change."""
        state = self._state
        unknown = sorted(set(requested.nodes) - state.with_lifecycle)
        if unknown:
            why = f"not lifecycle nodes of this launch: {', '.join(unknown)}"
            return ChangeAnswer(success=False, why=why)
        if requested.transition not in TRANSITIONS:
            why = f"unknown transition `{requested.transition}`"
            return ChangeAnswer(success=False, why=why)
        lost = sorted(state.lost.intersection(requested.nodes))
        if lost:
            why = f"crashed and not restarted: {', '.join(lost)}"
            return ChangeAnswer(success=False, why=why)
        answer = self._runner.run(
            Change(
                transition=TRANSITIONS[requested.transition],
                nodes=frozenset(requested.nodes) or state.counted(),
                limit_s=requested.timeout_s or self._context.limits.transition_s,
            )
        )
        if state.are_finalized(state.counted()):
            self._run.stop(NOT_BY_US)
        return answer

    # --- shutdown ---

    def _bring_down(self) -> None:
        """Shut down the nodes, controllers before the robot, then signal the processes to end."""
        context, state = self._context, self._state
        busy = frozenset(state.in_transition)
        self._go_down()
        context.publisher.phase("stopping", self._run.reason)
        context.publisher.in_transition("shuttingdown")
        silent = set(state.hung)
        stuck = {state.unit_of.get(node, node): node for node in sorted(silent)}
        for node in stuck.values():
            self._control.report_evidence(node)
        for tier in tiers_down(state.plan):
            self._take_down(state.with_lifecycle.intersection(tier), busy, silent)
        for unit in {state.unit_of[n] for n in silent if state.is_local(n)}:
            if not state.hung.isdisjoint(state.units[unit].node_names):
                self._control.kill(unit)
        self._control.end_all()
        for unit in sorted(state.running):
            self._run.fail(f"{unit}: the process is still running after SIGKILL")
        context.publisher.in_transition(FINALIZED)
        context.publisher.phase("stopped")

    def _go_down(self) -> None:
        """From here on, processes may end, no node is watched and no change is made."""
        self._run.go_down(self._context.loop.now())
        self._busy_with = "shutting down"
        self._context.heartbeat.clear()
        # An inactive robot reports no rejections, so its last report is out of date.
        for node in [n for n in self._rejections if self._state.states.get(n) != ACTIVE]:
            del self._rejections[node]
        while self._changes:
            self._refuse(self._changes.popleft())

    def _take_down(self, nodes: Collection[str], busy: frozenset[str], silent: set[str]) -> None:
        """Take a tier down.

        Args:
            nodes: full names.
            busy: those that were in a transition when the stop was requested.
            silent: those that do not answer; they get signals instead of requests.
        """
        state, limits = self._state, self._context.limits
        present = {n for n in nodes if n in state.ready - silent and state.is_present(n)}
        for node in sorted(self._runner.learn_states(present)):
            silent.add(node)
            if node not in busy and not self._run.force_quit:
                text = f"{node}: did not report its state within {limits.answer_s:g} s"
                self._run.fail(text, node)
        for transition in WAY_DOWN:
            if self._run.force_quit:
                return
            members = [
                node
                for node in present - silent
                if not state.is_resting(node) or state.states[node] in transition.starts
            ]
            # Nodes in a transition get every request in turn; a rejection is not a failure.
            unsettled = {node for node in members if not state.is_resting(node)}
            for member in self._runner.request_all(transition, members, limits.down_s).values():
                self._judge(transition, member, unsettled, silent)

    def _judge(
        self, transition: Transition, member: Member, unsettled: Collection[str], silent: set[str]
    ) -> None:
        node = member.node
        if member.result == "timed out":
            silent.add(node)
        is_refused = member.result == "refused" and node not in unsettled
        # The answer to `shutdown` may be lost, because the process then exits.
        has_vanished = member.result == "gone" and transition.goal != FINALIZED
        if member.result == "timed out" or is_refused or has_vanished:
            self._run.fail(reason(member, transition, self._context.limits.down_s), node)

    # --- between two events: hangs and rates ---

    def _watch(self, nodes: Iterable[str]) -> None:
        """From now on, expect heartbeats from these nodes."""
        self._context.heartbeat.watch(nodes, self._context.loop.now())

    def _check_nodes(self, now: float) -> Hung | None:
        """Query the watched nodes for heartbeats; return the first one that hangs."""
        heartbeat = self._context.heartbeat
        late = heartbeat.late(now, is_stack_busy=bool(self._state.moving))
        hung = [self._hangs(node, seconds) for node, seconds in late]
        for node in heartbeat.due(now):
            self._context.lifecycle.ask_state(node)
        self._publish_rates(self._rates.silence(now))
        return next((event for event in hung if event is not None), None)

    def _hangs(self, node: str, seconds: float) -> Hung | None:
        """Record a hang; None if it is already known and requires nothing more."""
        state = self._state
        hung = Hung(node=node, seconds=seconds)
        if node == state.lead:
            self._run.fail(f"the lead {node} has not answered for {seconds:.1f} s")
            return hung
        if node in state.hung:
            return hung if self._give_up_if_overdue(hung) else None
        is_known = not state.hung.isdisjoint(state.housemates(node))
        state.hung.add(node)
        self._context.publisher.publish(hung)
        if not is_known:
            # All nodes in a process hang at the same time; nothing shows which one is the cause.
            who = state.unit_of.get(node, node)
            self._restarts.crashed(who, "hung", f"{who} hangs: no answer for {seconds:.1f} s")
        return hung

    def _give_up_if_overdue(self, hung: Hung) -> bool:
        """Fail the run if a node on another device has been missing for too long."""
        node, state = hung.node, self._state
        if state.is_local(node) or state.on_crash(node) != "restart":
            return False
        if hung.seconds <= self._context.limits.restart_window_s:
            return False
        back = "and the launch on its device has not restarted it"
        self._run.fail(f"{node} has not answered for {hung.seconds:.0f} s, {back}", node)
        return True

    def _publish_rates(self, events: Iterable[OutputEvent]) -> None:
        """Publish changes in rates; with strict rates, a missed rate ends the run."""
        for event in events if not self._run.is_going_down else ():
            self._context.publisher.publish(event)
            if not self._strict_rates:
                continue
            if isinstance(event, RateBroken) or (
                isinstance(event, RatesUnreported) and event.unknown
            ):
                self._run.fail(f"{event.node}: {event.how}", event.node)

    # --- input events ---

    def _dispatch(self, event: InputEvent) -> None:
        lead = self._state.lead
        match event:
            case ProcessStarted() if event.process in self._state.units:
                self._process_started(event)
            case ProcessEnded() if event.process in self._state.units:
                self._process_ended(event)
            case Ready():
                self._ready(event)
            case Answered(node=node):
                self._state.in_transition.discard(node)
                self._settled(node)
                self._alive(node)
                self._answered_late(event)
            case StateAnswered(node=node, state=state):
                self._alive(node)
                self._state_answered(node, state)
            # A transition requested here may take as long as the request allows.
            case TransitionStarted(node=node) if node not in {lead, *self._state.in_transition}:
                now, limit_s = self._context.loop.now(), self._context.limits.transition_s
                self._context.heartbeat.allow(self._state.housemates(node), now, limit_s)
            case StateSeen(node=node) if node != lead:
                self._settled(node)
                self._alive(node)
                self._state_seen(event)
            case Failed(node=node) if node != lead:
                self._failed(event)
            case RatesReported() | RejectionReported() | ActivationReported() | VideoReported():
                self._reported(event)
            case PageReported():
                self._page_reported(event)
            case _:
                self._dispatch_request(event)

    def _reported(
        self, event: RatesReported | RejectionReported | ActivationReported | VideoReported
    ) -> None:
        """Handle a node's report on `/diagnostics`."""
        match event:
            case RatesReported():
                self._publish_rates(self._rates.received(event, self._context.loop.now()))
            case RejectionReported(node=node, seconds=0.0):
                self._rejections.pop(node, None)
            case RejectionReported(node=node):
                self._rejections[node] = event
            case _:
                self._context.publisher.publish(event)

    def _page_reported(self, event: PageReported) -> None:
        state = self._state
        if event.node in state.unit_of and event.url != state.pages.get(event.node, ""):
            state.pages[event.node] = event.url
            self._context.publisher.publish(event)

    def _dispatch_request(self, event: InputEvent) -> None:
        """Dispatch an event from outside the stack."""
        match event:
            case StopRequested(reason=reason, is_urgent=is_urgent):
                self._run.request_stop(reason, self._context.loop.now(), is_urgent=is_urgent)
            case StatusRequested():
                event.reply(self._context.publisher.status())
            case UnknownPublisherFound(topic=topic, node=node):
                if not self._run.is_going_down:
                    text = f"{node}, which is not part of this stack, also publishes on {topic}"
                    self._run.fail(text)
            case ChangeRequested() if self._busy_with:
                self._refuse(event)
            case ChangeRequested():
                self._changes.append(event)
            case _:
                pass

    def _refuse(self, requested: ChangeRequested) -> None:
        requested.reply(ChangeAnswer(success=False, why=f"the stack is {self._busy_with}"))

    def _process_started(self, event: ProcessStarted) -> None:
        state = self._state
        state.pids[event.process] = event.pid
        self._context.publisher.publish(event)
        # Start watching only now: until this point, a foreign node with the same name might have
        # been running.
        names = state.units[event.process].node_names
        self._context.lifecycle.watch(state.with_lifecycle.intersection(names))

    def _process_ended(self, event: ProcessEnded) -> None:
        state, unit = self._state, event.process
        names = state.units[unit].node_names
        is_early = state.is_early(unit)
        has_lifecycle = state.with_lifecycle.issuperset(names)
        # Once its nodes are finalized, a process has nothing left to do but exit.
        is_over = has_lifecycle and state.are_finalized(names)
        state.process_ended(unit)
        self._context.heartbeat.forget(names)
        # A node that is still in its constructor handles the second SIGTERM by exiting.
        early = {-signal.SIGTERM, SIGNAL_EXIT + signal.SIGTERM}
        expected = {0} | (early if is_early else set())
        if is_over or not has_lifecycle:
            expected |= {-signal.SIGINT, -signal.SIGTERM}
        if not self._run.is_going_down:
            for name in names:
                self._rejections.pop(name, None)
        if self._control.was_killed(unit):
            return
        culprit = state.culprit(unit, event.text)
        if not self._run.is_going_down:
            self._context.publisher.publish(event)
            self._restarts.crashed(culprit, "ended", f"{unit}: {event.how}")
        elif event.code not in expected:
            self._context.publisher.publish(event)
            self._run.fail(f"{unit}: {event.how}", culprit)

    def _ready(self, event: Ready) -> None:
        state, node = self._state, event.node
        if node == state.lead:
            self._watch({node})
            return
        if not state.is_local(node):
            self._context.lifecycle.ask_state(node)
        elif node not in state.ready:
            # On a device that does not lead, the lead may already have changed it.
            state.states[node] = event.state
        state.ready.add(node)

    def _settled(self, node: str) -> None:
        """Expect heartbeats of a process as usual, unless another of its nodes is in transition."""
        names = self._state.housemates(node)
        if self._state.in_transition.isdisjoint(names):
            self._context.heartbeat.allow(names, self._context.loop.now(), 0.0)

    def _alive(self, node: str) -> None:
        state = self._state
        self._context.heartbeat.received(node, self._context.loop.now())
        if node in state.hung and not self._run.is_going_down:
            state.hung.discard(node)
            self._context.publisher.publish(AnswersAgain(node=node))
            if node not in state.in_transition:
                # It may now be running in a new process that another launch started.
                state.states.pop(node, None)

    def _answered_late(self, answer: Answered) -> None:
        """Handle a late answer: undo the transition if it is no longer requested."""
        context, state = self._context, self._state
        node, transition = answer.node, TRANSITIONS[answer.transition]
        requested_s = context.pending.pop_late(answer)
        if requested_s is None or not answer.success:
            return
        state.states[node] = transition.goal
        took_s = context.loop.now() - requested_s
        context.publisher.publish(
            TransitionEnded(node=node, transition=transition.name, result="reached", seconds=took_s)
        )
        is_requested = state.requested.get(node) == transition.goal
        is_down = self._run.is_going_down
        if transition.is_up and transition.undo and not is_requested and not is_down:
            context.publisher.episode("rolling back", node)
            self._changes.append(
                ChangeRequested(transition=transition.undo, nodes=(node,), reply=lambda _: None)
            )

    def _state_answered(self, node: str, answer: str) -> None:
        """Handle a node's answer to a state query; ignored during a transition."""
        states = self._state.states
        if node == self._state.lead or node in self._state.in_transition:
            return
        if self._run.is_going_down or node not in states:
            states[node] = answer
            self._context.publisher.publish_state()

    def _state_seen(self, event: StateSeen) -> None:
        """Handle a node's change of state, requested here or elsewhere."""
        state, lead = self._state, self._state.lead
        if self._context.pending.pop(event) or self._run.is_going_down:
            return
        if state.is_present(event.node):
            state.states[event.node] = event.state
        if lead is not None and not self._context.heartbeat.watches(lead):
            self._watch({lead})  # the lead changed the state, so the lead is running
        if event.transition:
            state.requested[event.node] = event.state
        self._context.publisher.publish(event)
        # A state change without a transition results from a failure, which has its own event.
        if event.transition and state.are_finalized(state.local_nodes() - state.lost):
            self._run.stop(NOT_BY_US)

    def _failed(self, event: Failed) -> None:
        """Handle a failure as a crash, unless it happened in a requested transition."""
        state = self._state
        if self._context.pending.pop(event) or self._run.is_going_down:
            return
        self._context.publisher.publish(event)
        # Nothing shows whether such a transition was requested, so assume that the node failed.
        is_unknown = event.fault == UNKNOWN_FAULT and event.transition in FAULT_TRANSITIONS
        if (is_unknown or not event.transition) and state.is_present(event.node):
            state.states[event.node] = UNCONFIGURED
            first = event.fault.splitlines()[0] if event.fault else "no reason given"
            self._restarts.crashed(event.node, "fault", f"{event.node} failed: {first}")
