"""Takes a group of nodes through a transition, tier by tier; what goes wrong is taken back."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field, replace

from obk_cli.launch.events import Answered, StateAnswered, TransitionEnded
from obk_cli.launch.hearing import Hearing
from obk_cli.launch.order import tiers_down, tiers_up
from obk_cli.launch.roster import Roster
from obk_cli.runs.lifecycle import TRANSITIONS, Transition
from obk_cli.runs.protocol import ChangeAnswer, Member, Result

__all__ = ["Change", "ask_all", "learn_states", "make_change", "reason"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """What is to be done to whom."""

    transition: Transition
    nodes: frozenset[str]
    """Full names; those that are there already are left alone."""
    limit_s: float
    """For each node [s]."""


@dataclass(slots=True, kw_only=True)
class _Progress:
    """What has become of a change so far."""

    members: dict[str, Member] = field(default_factory=dict)
    reached: list[str] = field(default_factory=list)

    @property
    def culprit(self) -> Member | None:
        return next((m for m in self.members.values() if m.is_culprit), None)


def make_change(hearing: Hearing, change: Change) -> ChangeAnswer:
    """Take nodes to a transition's goal; on failure those that got there are taken back.

    Nothing is begun when a node is in a state from which the transition is not possible.
    """
    transition = change.transition
    obstacle = _obstacle(hearing, change)
    if obstacle:
        return ChangeAnswer(success=False, why=obstacle)
    progress = _Progress()
    hearing.story.is_moving(transition.passes)
    for tier in _tiers(hearing, change):
        _take_tier(hearing, change, tier, progress)
        if progress.culprit is not None or not hearing.may_go_on:
            break
    culprit = progress.culprit
    if culprit is not None and hearing.may_go_on:
        _take_back(hearing, change, progress)
        _look_where_they_are(hearing, progress)
    hearing.story.is_moving("")
    members = tuple(progress.members.values())
    if culprit is not None:
        why = reason(culprit, transition, change.limit_s)
        return ChangeAnswer(success=False, why=why, members=members)
    if not hearing.may_go_on:
        why = hearing.stop or hearing.failures[0].text
        return ChangeAnswer(success=False, why=f"the stack comes down: {why}", members=members)
    for member in members:
        hearing.roster.wanted[member.node] = transition.goal
    return ChangeAnswer(success=True, members=members)


def ask_all(
    hearing: Hearing, transition: Transition, nodes: Collection[str], limit_s: float
) -> dict[str, Member]:
    """Ask nodes for a transition at once and wait for every answer, at most `limit_s`.

    Those of which the caller need not wait any more are left out of the result.
    """
    asked = hearing.clock()
    roster = hearing.roster
    # A hung one would do it whenever it wakes.
    waiting = {node for node in nodes if roster.is_present(node) and node not in roster.hung}
    members = {node: _gone(roster, node) for node in nodes if node not in waiting}
    for node in sorted(waiting):
        hearing.request(node, transition.name, limit_s)
    while waiting and not _must_leave(hearing) and (heard := hearing.hear(asked + limit_s)):
        if (
            isinstance(heard, Answered)
            and heard.node in waiting
            and heard.transition == transition.name
        ):
            waiting.discard(heard.node)
            members[heard.node] = _concluded(hearing, transition, heard, asked)
        for node in sorted(waiting):
            if not roster.is_present(node) or node in roster.hung:
                waiting.discard(node)
                members[node] = _gone(roster, node)
    if _must_leave(hearing):
        return members
    for node in sorted(waiting):
        seconds = hearing.clock() - asked
        members[node] = Member(node=node, result="timed out", state=roster.states.get(node, ""))
        hearing.echoes.give_up(node, transition.name, asked)
        hearing.story.tell(
            TransitionEnded(
                node=node, transition=transition.name, result="timed out", seconds=seconds
            )
        )
        hearing.give_evidence(node)
    return members


def reason(culprit: Member, transition: Transition, limit_s: float) -> str:
    """Why a node's part of a transition failed, as a sentence that names it."""
    how = {
        "refused": "failed",
        "timed out": f"was not done within {limit_s:.1f} s",
        "gone": "was cut short",
    }
    first = f": {culprit.fault.splitlines()[0]}" if culprit.fault else ""
    return f"{culprit.node}: the transition `{transition.name}` {how[culprit.result]}{first}"


def _gone(roster: Roster, node: str) -> Member:
    why = "the node hangs" if node in roster.hung else "the node is gone"
    return Member(node=node, result="gone", state=roster.states.get(node, ""), fault=why)


def learn_states(hearing: Hearing, nodes: Iterable[str]) -> frozenset[str]:
    """Ask nodes where they are, themselves; gives those that do not answer in time."""
    waiting = set(nodes)
    for node in sorted(waiting):
        hearing.lifecycle.ask_state(node)
    deadline = hearing.clock() + hearing.limits.answer_s
    while waiting and not hearing.is_in_a_hurry and (heard := hearing.hear(deadline)):
        if isinstance(heard, StateAnswered):
            waiting.discard(heard.node)
            hearing.roster.states[heard.node] = heard.state
        waiting = {node for node in waiting if hearing.roster.is_present(node)}
    return frozenset(waiting)


def _must_leave(hearing: Hearing) -> bool:
    """Whether nothing is to be waited for any more: the stack comes down, down: in a hurry."""
    return hearing.is_in_a_hurry if hearing.is_going_down else not hearing.may_go_on


def _tiers(hearing: Hearing, change: Change) -> tuple[tuple[str, ...], ...]:
    plan = hearing.roster.plan
    tiers = tiers_up(plan) if change.transition.is_up else tiers_down(plan)
    chosen = (tuple(node for node in tier if node in change.nodes) for tier in tiers)
    return tuple(tier for tier in chosen if tier)


def _obstacle(hearing: Hearing, change: Change) -> str:
    """Why the transition cannot begin; empty when it can."""
    transition = change.transition
    states = {node: hearing.roster.states.get(node, "unknown") for node in sorted(change.nodes)}
    for node, state in states.items():
        if state != transition.goal and state not in transition.starts:
            starts = " or ".join(sorted(transition.starts))
            return f"`{transition.name}` starts from {starts}, and {node} is {state}"
    return ""


def _take_tier(
    hearing: Hearing, change: Change, tier: tuple[str, ...], progress: _Progress
) -> None:
    states = hearing.roster.states
    goal = change.transition.goal
    to_ask = [node for node in tier if states.get(node) != goal]
    for node in tier:
        if node not in to_ask:
            progress.members[node] = Member(node=node, result="there already", state=goal)
            name = change.transition.name
            hearing.story.tell(
                TransitionEnded(node=node, transition=name, result="there already", seconds=0.0)
            )
    members = ask_all(hearing, change.transition, to_ask, change.limit_s)
    progress.members.update(members)
    progress.reached.extend(node for node in tier if node in members and _is_reached(members[node]))


def _take_back(hearing: Hearing, change: Change, progress: _Progress) -> None:
    """Lead those that got there back to where they were."""
    if not change.transition.undo or not progress.reached:
        return
    hearing.story.episode("rolling back", ", ".join(progress.reached))
    undo = TRANSITIONS[change.transition.undo]
    for tier in reversed(_tiers(hearing, change)):
        if not hearing.may_go_on:
            return  # Whatever comes up now would come down at once.
        nodes = [node for node in tier if node in progress.reached]
        for node, member in ask_all(hearing, undo, nodes, change.limit_s).items():
            back = replace(progress.members[node], state=member.state)
            progress.members[node] = (
                replace(back, result="taken back") if (_is_reached(member)) else back
            )


def _look_where_they_are(hearing: Hearing, progress: _Progress) -> None:
    """A node that refused may have gone through error processing, to another state."""
    refused = [member.node for member in progress.members.values() if member.result == "refused"]
    learn_states(hearing, refused)
    for node in refused:
        state = hearing.roster.states.get(node, "")
        progress.members[node] = replace(progress.members[node], state=state)


def _is_reached(member: Member) -> bool:
    return member.result == "reached"


def _concluded(hearing: Hearing, transition: Transition, heard: Answered, asked: float) -> Member:
    result: Result = "reached" if heard.success else "refused"
    states = hearing.roster.states
    if heard.success:
        states[heard.node] = transition.goal
    hearing.story.tell(
        TransitionEnded(
            node=heard.node,
            transition=transition.name,
            result=result,
            seconds=hearing.clock() - asked,
            fault=heard.fault,
        )
    )
    state = states.get(heard.node, "")
    return Member(node=heard.node, result=result, state=state, fault=heard.fault)
