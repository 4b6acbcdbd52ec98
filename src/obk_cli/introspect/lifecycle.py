"""States and transitions of nodes: from the launchers of this host, otherwise over ROS.

ROS is loaded only if no launcher here can answer, so that an answer does not take longer.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from obelisk_spec.suggestions import did_you_mean
from obk_cli.errors import CommandFailedError
from obk_cli.ros.environment import RosEnvironment
from obk_cli.runs.folder import Run, runs_folder
from obk_cli.runs.lifecycle import TRANSITIONS
from obk_cli.runs.protocol import ChangeAnswer, Member, NodeStatus, Result, ask_change
from obk_cli.runs.registry import (
    NO_ANSWER,
    NodeSelection,
    in_tier_order,
    live_runs,
    live_stacks,
    node_statuses,
    select_nodes,
    select_runs,
    select_stack,
    stack_nodes,
)

if TYPE_CHECKING:
    from obk_cli.ros.lifecycle_client import LifecycleClient

__all__ = ["LifecycleRequest", "change_states", "node_states", "possible_transitions"]

LAUNCHES_OWN_S: Final = 60.0
"""The assumed limit of a launch: a client does not know it [s]."""
MARGIN_S: Final = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LifecycleRequest:
    """What a user wants to know about, or change."""

    names: tuple[str, ...] = ()
    """Nodes, full or in short, or sections; none: all."""
    run: str | None = None
    """A config's name or a run folder's; None: whatever runs in the ROS domain."""
    timeout_s: float | None = None
    """For one node's answer or transition [s]; None: the launch's own."""


def node_states(environment: RosEnvironment, request: LifecycleRequest) -> Mapping[str, str]:
    """The states of nodes by full name, `no answer` where a node gives none.

    Raises:
        CommandFailedError: there is no such run or node, or no ROS.
    """
    runs = _runs(environment, request)
    known = node_statuses(live_stacks(runs), request.names) if runs else None
    if known is not None:
        return {name: _state(known[name]) for name in in_tier_order(known)}

    search = _Search(names=request.names, expected=_nodes(runs), if_none=_if_none(environment))
    return _states_in_graph(environment, search, request.timeout_s)


def change_states(
    environment: RosEnvironment, transition: str, request: LifecycleRequest
) -> ChangeAnswer:
    """Take nodes through a transition.

    Raises:
        CommandFailedError: there is no such run or node, its launcher does not answer, or no ROS.
        MisuseError: nodes of more than one stack may be meant.
    """
    runs = _runs(environment, request)
    choice = select_stack(live_stacks(runs), request.names)
    if choice is not None:
        return _ask_launcher(choice, transition, request.timeout_s)

    search = _Search(names=request.names, expected=_nodes(runs), if_none=_if_none(environment))
    return _change_in_graph(environment, transition, search, request.timeout_s)


def possible_transitions(state: str) -> tuple[str, ...]:
    """The transitions that a node can be asked for in a state."""
    return tuple(t.name for t in TRANSITIONS.values() if state in t.starts)


def _runs(environment: RosEnvironment, request: LifecycleRequest) -> Mapping[Path, Run]:
    return select_runs(runs_folder(environment.variables), request.run, domain=environment.domain)


def _state(node: NodeStatus) -> str:
    return NO_ANSWER if node.hangs else node.state


def _ask_launcher(choice: NodeSelection, transition: str, timeout_s: float | None) -> ChangeAnswer:
    stack = choice.stack
    tiers = len({node.section for node in stack.life_cycle_nodes})
    # There and back, tier by tier.
    wait_s = 2 * tiers * (timeout_s or LAUNCHES_OWN_S) + MARGIN_S
    answer = ask_change(stack.folder, transition, choice.nodes, timeout_s=timeout_s, wait_s=wait_s)
    if answer is None:
        raise CommandFailedError(
            f"the launcher of `{stack.run.name}` (process {stack.run.pid}) did not answer",
            help="check the stack with `obk ps` and `obk logs`",
        )
    return answer


def _nodes(runs: Mapping[Path, Run]) -> tuple[str, ...]:
    return tuple(node for run in runs.values() for node in run.nodes)


def _if_none(environment: RosEnvironment) -> str:
    """What to do when there is nothing in this ROS domain."""
    live = live_runs(runs_folder(environment.variables))
    domains = sorted({run.domain for run in live} - {environment.domain})
    if domains:
        where = " and ".join(map(str, domains))
        return f"a stack is running in the ROS domain {where}; set ROS_DOMAIN_ID"
    return (
        "start a stack with `obk launch`; a stack on another host needs "
        "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET on both hosts"
    )


DISCOVERY_S: Final = 3.0
"""At least for nodes that are known to run [s]."""
NOTHING_S: Final = 2.0
"""After which there is nothing [s]."""
QUIET_S: Final = 1.0
"""After the last one that was found; of a stack, half of the nodes would be a wrong answer [s]."""
ANSWER_S: Final = 2.0
"""For a node's state, unless set [s]."""
TRANSITION_S: Final = 10.0
"""For one node's transition, unless set [s]."""
UP: Final = ("configure", "activate")
NODE_NAME: Final = "obk_lifecycle"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Search:
    """Which nodes are looked for in the graph."""

    names: tuple[str, ...]
    """As a user gives them; none: all of a stack."""
    expected: tuple[str, ...] = ()
    """Full names of nodes that are known to run."""
    if_none: str
    """What to do when there are no nodes at all."""


def _states_in_graph(
    environment: RosEnvironment, search: _Search, timeout_s: float | None
) -> Mapping[str, str]:
    """The states of nodes by full name, `no answer` where a node gives none.

    Args:
        environment: of ROS.
        search: which nodes.
        timeout_s: for those that are known to run, and for each node's answer [s]; None: not set.

    Raises:
        CommandFailedError: there is no such node, or no ROS.
    """
    from obk_cli.ros.lifecycle_client import open_lifecycle_client

    with open_lifecycle_client(NODE_NAME, environment) as ros:
        chosen = _choose(ros, environment, search, timeout_s)
        return {node: _ros_state(ros, node, timeout_s) for node in chosen}


def _change_in_graph(
    environment: RosEnvironment, transition: str, search: _Search, timeout_s: float | None
) -> ChangeAnswer:
    """Take nodes to a transition's goal one after another; ends at the first that stays away.

    Up goes the robot first, down the controllers. A node that is there already is left alone.

    Args:
        environment: of ROS.
        transition: `activate`, ...
        search: which nodes.
        timeout_s: for those that are known to run, and for each node's answer and transition [s];
            None: not set.

    Raises:
        CommandFailedError: there is no such node, or no ROS.
    """
    members: list[Member] = []
    from obk_cli.ros.lifecycle_client import open_lifecycle_client

    with open_lifecycle_client(NODE_NAME, environment) as ros:
        chosen = _choose(ros, environment, search, timeout_s)
        for node in chosen if transition in UP else reversed(chosen):
            member = _taken(ros, transition, node, timeout_s)
            members.append(member)
            if member.is_culprit:
                why = f"{node}: {member.fault}"
                return ChangeAnswer(success=False, why=why, members=tuple(members))
    return ChangeAnswer(success=True, members=tuple(members))


def _choose(
    ros: "LifecycleClient", environment: RosEnvironment, search: _Search, timeout_s: float | None
) -> tuple[str, ...]:
    """The nodes meant, in tier order, once they are in the graph."""
    awaited = search.expected or tuple(name for name in search.names if name.startswith("/"))
    is_any = bool(awaited) or bool(ros.find((), NOTHING_S, 0.0))
    find_s = max(DISCOVERY_S, timeout_s or 0.0) if awaited else DISCOVERY_S
    seen = ros.find(awaited, find_s, QUIET_S) if is_any else ()
    # A node of a live run that is not found is there nevertheless: it does not answer.
    found = tuple(dict.fromkeys((*seen, *search.expected)))
    if not found:
        raise CommandFailedError(
            f"no life-cycle node was found in the ROS domain {environment.domain}",
            help=search.if_none,
        )
    if not search.names:
        return in_tier_order(search.expected) or stack_nodes(found)
    for name in search.names:
        if not select_nodes(name, found):
            raise CommandFailedError(
                f"there is no life-cycle node `{name}` in the ROS domain {environment.domain}",
                help=did_you_mean(name, found),
            )
    return in_tier_order({node for name in search.names for node in select_nodes(name, found)})


def _ros_state(ros: "LifecycleClient", node: str, timeout_s: float | None) -> str:
    return ros.state(node, timeout_s or ANSWER_S) or NO_ANSWER


def _taken(ros: "LifecycleClient", transition: str, node: str, timeout_s: float | None) -> Member:
    """Ask a node for a transition, unless it is there already."""
    table = TRANSITIONS[transition]
    wait_s = timeout_s or TRANSITION_S
    before = _ros_state(ros, node, timeout_s)
    if before == table.goal:
        return Member(node=node, result="there already", state=before)
    answer = ros.change(node, transition, wait_s)
    if answer is not None and answer.success:
        return Member(node=node, result="reached", state=table.goal)
    result: Result = "refused"
    if answer is None:
        result, fault = "timed out", f"no answer to `{transition}` within {wait_s:g} s"
    elif before not in table.starts:
        starts = " or ".join(sorted(table.starts))
        fault = f"`{transition}` is possible in state {starts}, but the node is {before}"
    else:
        fault = f"`{transition}` failed: {answer.fault or 'the node gave no reason'}"
    return Member(node=node, result=result, state=_ros_state(ros, node, timeout_s), fault=fault)
