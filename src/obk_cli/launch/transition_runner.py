"""Take a group of nodes through a transition, tier by tier; roll back if one of them fails."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field, replace

from obk_cli.launch.event_loop import RunContext
from obk_cli.launch.events import Answered, StateAnswered, TransitionEnded
from obk_cli.launch.processes import ProcessControl
from obk_cli.launch.transitions import UNKNOWN, tiers_down, tiers_up
from obk_cli.runs.lifecycle import ACTIVE, TRANSITIONS, Transition
from obk_cli.runs.protocol import ChangeAnswer, Member, Result

__all__ = ["Change", "TransitionRunner", "reason"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """A transition of several nodes."""

    transition: Transition
    nodes: frozenset[str]
    """Full names; nodes already in the goal state are skipped."""
    limit_s: float
    """Limit for each node [s]."""


@dataclass(slots=True, kw_only=True)
class _Progress:
    """The results of a change so far."""

    members: dict[str, Member] = field(default_factory=dict)
    reached: list[str] = field(default_factory=list)

    @property
    def culprit(self) -> Member | None:
        return next((m for m in self.members.values() if m.is_culprit), None)


def reason(culprit: Member, transition: Transition, limit_s: float) -> str:
    """Why a node's part of a transition failed, as a sentence with the node's name."""
    how = {
        "refused": "failed",
        "timed out": f"did not finish within {limit_s:.1f} s",
        "gone": "was interrupted",
    }
    first = f": {culprit.fault.splitlines()[0]}" if culprit.fault else ""
    return f"{culprit.node}: the transition `{transition.name}` {how[culprit.result]}{first}"


class TransitionRunner:
    """Requests transitions of nodes and waits for their answers."""

    def __init__(self, context: RunContext, control: ProcessControl) -> None:
        self._context = context
        self._control = control

    def run(self, change: Change) -> ChangeAnswer:
        """Take nodes to a transition's goal; on failure, roll back those that reached it.

        Nothing is requested if a node is in a state that does not allow the transition.
        """
        context, transition = self._context, change.transition
        obstacle = self._obstacle(change)
        if obstacle:
            return ChangeAnswer(success=False, why=obstacle)
        progress = _Progress()
        context.publisher.in_transition(transition.passes)
        for tier in self._tiers(change):
            self._take_tier(change, tier, progress)
            if progress.culprit is not None or not context.run.may_go_on:
                break
        culprit = progress.culprit
        if culprit is not None and context.run.may_go_on:
            self._roll_back(change, progress)
            self._learn_refused(progress)
        context.publisher.in_transition("")
        members = tuple(progress.members.values())
        if culprit is not None:
            why = reason(culprit, transition, change.limit_s)
            return ChangeAnswer(success=False, why=why, members=members)
        if not context.run.may_go_on:
            why = f"the stack is shutting down: {context.run.stop_reason or context.run.reason}"
            return ChangeAnswer(success=False, why=why, members=members)
        for member in members:
            context.state.requested[member.node] = transition.goal
        return ChangeAnswer(success=True, members=members)

    def request_all(
        self, transition: Transition, nodes: Collection[str], limit_s: float
    ) -> dict[str, Member]:
        """Request a transition of nodes at once and wait for every answer, at most `limit_s`.

        The result omits nodes for which the caller need not wait any more.
        """
        context, state = self._context, self._context.state
        start = context.loop.now()
        # A hung node would do it whenever it wakes up.
        waiting = {node for node in nodes if state.is_present(node) and node not in state.hung}
        members = {node: self._cut_short(node) for node in nodes if node not in waiting}
        for node in sorted(waiting):
            self._request(node, transition, limit_s)
        while (
            waiting and not context.run.must_leave and (event := context.loop.wait(start + limit_s))
        ):
            if (
                isinstance(event, Answered)
                and event.node in waiting
                and event.transition == transition.name
            ):
                waiting.discard(event.node)
                members[event.node] = self._concluded(transition, event, start)
            for node in sorted(waiting):
                if not state.is_present(node) or node in state.hung:
                    waiting.discard(node)
                    members[node] = self._cut_short(node)
        if context.run.must_leave:
            return members
        for node in sorted(waiting):
            members[node] = self._timed_out(node, transition, start)
        return members

    def learn_states(self, nodes: Iterable[str]) -> frozenset[str]:
        """Query nodes for their states; return those that do not answer in time."""
        context, state = self._context, self._context.state
        waiting = set(nodes)
        for node in sorted(waiting):
            context.lifecycle.ask_state(node)
        deadline = context.loop.now() + context.limits.answer_s
        while waiting and not context.run.force_quit and (event := context.loop.wait(deadline)):
            if isinstance(event, StateAnswered):
                waiting.discard(event.node)
                state.states[event.node] = event.state
            waiting = {node for node in waiting if state.is_present(node)}
        return frozenset(waiting)

    def _request(self, node: str, transition: Transition, limit_s: float) -> None:
        """Request a transition of a node, whose process may be busy with it for this long [s]."""
        context = self._context
        now = context.loop.now()
        if transition.goal == ACTIVE:
            context.heartbeat.watch((node,), now)
        context.heartbeat.allow(context.state.housemates(node), now, limit_s)
        context.pending.add(node, transition.name)
        context.state.in_transition.add(node)
        context.lifecycle.request(node, transition.name)

    def _concluded(self, transition: Transition, answer: Answered, start: float) -> Member:
        result: Result = "reached" if answer.success else "refused"
        states = self._context.state.states
        if answer.success:
            states[answer.node] = transition.goal
        self._publish(answer.node, transition, result, start, answer.fault)
        state = states.get(answer.node, "")
        return Member(node=answer.node, result=result, state=state, fault=answer.fault)

    def _timed_out(self, node: str, transition: Transition, start: float) -> Member:
        state = self._context.state.states.get(node, "")
        self._context.pending.time_out(node, transition.name, start)
        self._publish(node, transition, "timed out", start)
        self._control.report_evidence(node)
        return Member(node=node, result="timed out", state=state)

    def _cut_short(self, node: str) -> Member:
        state = self._context.state
        why = "the node hangs" if node in state.hung else "the node's process has exited"
        return Member(node=node, result="gone", state=state.states.get(node, ""), fault=why)

    def _publish(
        self,
        node: str,
        transition: Transition,
        result: Result,
        start: float | None = None,
        fault: str = "",
    ) -> None:
        """Publish a node's result; `start` is None if nothing was requested of it."""
        context = self._context
        context.publisher.publish(
            TransitionEnded(
                node=node,
                transition=transition.name,
                result=result,
                seconds=0.0 if start is None else context.loop.now() - start,
                fault=fault,
            )
        )

    def _tiers(self, change: Change) -> tuple[tuple[str, ...], ...]:
        plan = self._context.state.plan
        tiers = tiers_up(plan) if change.transition.is_up else tiers_down(plan)
        chosen = (tuple(node for node in tier if node in change.nodes) for tier in tiers)
        return tuple(tier for tier in chosen if tier)

    def _obstacle(self, change: Change) -> str:
        """Why the transition cannot start; empty if it can."""
        transition, states = change.transition, self._context.state.states
        for node in sorted(change.nodes):
            state = states.get(node, UNKNOWN)
            if state != transition.goal and state not in transition.starts:
                starts = " or ".join(sorted(transition.starts))
                return f"`{transition.name}` requires {starts}, but {node} is {state}"
        return ""

    def _take_tier(self, change: Change, tier: tuple[str, ...], progress: _Progress) -> None:
        states, transition = self._context.state.states, change.transition
        to_request = [node for node in tier if states.get(node) != transition.goal]
        for node in tier:
            if node not in to_request:
                progress.members[node] = Member(
                    node=node, result="already there", state=transition.goal
                )
                self._publish(node, transition, "already there")
        members = self.request_all(transition, to_request, change.limit_s)
        progress.members.update(members)
        progress.reached.extend(
            node for node in tier if node in members and members[node].result == "reached"
        )

    def _roll_back(self, change: Change, progress: _Progress) -> None:
        """Roll back the nodes that reached the goal."""
        if not change.transition.undo or not progress.reached:
            return
        context = self._context
        context.publisher.episode("rolling back", ", ".join(progress.reached))
        undo = TRANSITIONS[change.transition.undo]
        for tier in reversed(self._tiers(change)):
            if not context.run.may_go_on:
                return  # anything that comes up now would come down at once
            nodes = [node for node in tier if node in progress.reached]
            for node, member in self.request_all(undo, nodes, change.limit_s).items():
                back = replace(progress.members[node], state=member.state)
                progress.members[node] = (
                    replace(back, result="rolled back") if member.result == "reached" else back
                )

    def _learn_refused(self, progress: _Progress) -> None:
        """Query nodes that refused: error processing may have led them to another state."""
        refused = [m.node for m in progress.members.values() if m.result == "refused"]
        self.learn_states(refused)
        for node in refused:
            state = self._context.state.states.get(node, "")
            progress.members[node] = replace(progress.members[node], state=state)
