"""States and transitions of nodes: from the launchers on this host, otherwise over ROS.

ROS is loaded only if no launcher on this host can answer, because loading it takes a long time.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from obk_cli.errors import CommandFailedError
from obk_cli.introspect.resolve import near_help
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
"""Assumed transition limit of a launch, which a client does not know [s]."""
MARGIN_S: Final = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LifecycleRequest:
    """The nodes to query or change."""

    names: tuple[str, ...] = ()
    """Nodes (full or short names) or sections; empty: all."""
    run: str | None = None
    """Name of a config or run folder; None: any stack in the ROS domain."""
    timeout_s: float | None = None
    """Limit for one node's answer or transition [s]; None: the limit set at launch."""


def node_states(environment: RosEnvironment, request: LifecycleRequest) -> Mapping[str, str]:
    """The states of nodes by full name; `no answer` for nodes that do not answer.

    Raises:
        CommandFailedError: no such run or node exists, or ROS is missing.
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
        CommandFailedError: no such run or node exists, its launcher does not answer, or ROS is
            missing.
        MisuseError: the names match nodes of several stacks.
    """
    runs = _runs(environment, request)
    choice = select_stack(live_stacks(runs), request.names)
    if choice is not None:
        return _ask_launcher(choice, transition, request.timeout_s)

    search = _Search(names=request.names, expected=_nodes(runs), if_none=_if_none(environment))
    return _change_in_graph(environment, transition, search, request.timeout_s)


def possible_transitions(state: str) -> tuple[str, ...]:
    """The transitions that a node allows in a state."""
    return tuple(t.name for t in TRANSITIONS.values() if state in t.starts)


def _runs(environment: RosEnvironment, request: LifecycleRequest) -> Mapping[Path, Run]:
    return select_runs(runs_folder(environment.variables), request.run, domain=environment.domain)


def _state(node: NodeStatus) -> str:
    return NO_ANSWER if node.hangs else node.state


def _ask_launcher(choice: NodeSelection, transition: str, timeout_s: float | None) -> ChangeAnswer:
    stack = choice.stack
    tiers = len({node.section for node in stack.life_cycle_nodes})
    # Up and down, for every tier.
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
    """What the user can do if this ROS domain is empty."""
    live = live_runs(runs_folder(environment.variables))
    domains = sorted({run.domain for run in live} - {environment.domain})
    if domains:
        where = " and ".join(map(str, domains))
        what = "a stack is running in ROS domain"
        if len(domains) > 1:
            what = "stacks are running in ROS domains"
        return f"{what} {where}; set ROS_DOMAIN_ID"
    return (
        "start a stack with `obk launch`; a stack on another host needs "
        "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET on both hosts"
    )


DISCOVERY_S: Final = 3.0
"""Minimum discovery time for nodes that are known to run [s]."""
NOTHING_S: Final = 2.0
"""Time after which the domain counts as empty [s]."""
QUIET_S: Final = 1.0
"""Wait after the last discovered node, because half of a stack would be a wrong answer [s]."""
ANSWER_S: Final = 2.0
"""Default limit for a node's state [s]."""
TRANSITION_S: Final = 10.0
"""Default limit for one node's transition [s]."""
UP: Final = ("configure", "activate")
NODE_NAME: Final = "obk_lifecycle"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Search:
    """The nodes to find in the graph."""

    names: tuple[str, ...]
    """As given by the user; empty: all nodes of a stack."""
    expected: tuple[str, ...] = ()
    """Full names of nodes that are known to be running."""
    if_none: str
    """What the user can do if no node is found."""


def _states_in_graph(
    environment: RosEnvironment, search: _Search, timeout_s: float | None
) -> Mapping[str, str]:
    """The states of nodes by full name; `no answer` for nodes that do not answer.

    Args:
        environment: the ROS environment.
        search: the nodes.
        timeout_s: limit for discovering known nodes, and for each answer [s]; None: defaults.

    Raises:
        CommandFailedError: no such node exists, or ROS is missing.
    """
    from obk_cli.ros.lifecycle_client import LifecycleClient, open_client

    with open_client(NODE_NAME, environment, LifecycleClient) as ros:
        chosen = _choose(ros, environment, search, timeout_s)
        return {node: _ros_state(ros, node, timeout_s) for node in chosen}


def _change_in_graph(
    environment: RosEnvironment, transition: str, search: _Search, timeout_s: float | None
) -> ChangeAnswer:
    """Take nodes to a transition's goal one after another; stop at the first that fails.

    On the way up, the robot goes first; on the way down, the controllers. Nodes in the goal state
    are skipped.

    Args:
        environment: the ROS environment.
        transition: `activate`, ...
        search: the nodes.
        timeout_s: limit for discovering known nodes, and for each answer and transition [s]; None:
            defaults.

    Raises:
        CommandFailedError: no such node exists, or ROS is missing.
    """
    members: list[Member] = []
    from obk_cli.ros.lifecycle_client import LifecycleClient, open_client

    with open_client(NODE_NAME, environment, LifecycleClient) as ros:
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
    """The selected nodes in tier order, once they are in the graph."""
    awaited = search.expected or tuple(name for name in search.names if name.startswith("/"))
    is_any = bool(awaited) or bool(ros.find((), NOTHING_S, 0.0))
    find_s = max(DISCOVERY_S, timeout_s or 0.0) if awaited else DISCOVERY_S
    seen = ros.find(awaited, find_s, QUIET_S) if is_any else ()
    # A node of a live run that is not found still exists; it just does not answer.
    found = tuple(dict.fromkeys((*seen, *search.expected)))
    if not found:
        raise CommandFailedError(
            f"no lifecycle node was found in ROS domain {environment.domain}",
            help=search.if_none,
        )
    if not search.names:
        return in_tier_order(search.expected) or stack_nodes(found)
    for name in search.names:
        if not select_nodes(name, found):
            raise CommandFailedError(
                f"no lifecycle node `{name}` in ROS domain {environment.domain}",
                help=near_help(name, found),
            )
    return in_tier_order({node for name in search.names for node in select_nodes(name, found)})


def _ros_state(ros: "LifecycleClient", node: str, timeout_s: float | None) -> str:
    return ros.state(node, timeout_s or ANSWER_S) or NO_ANSWER


def _taken(ros: "LifecycleClient", transition: str, node: str, timeout_s: float | None) -> Member:
    """Request a transition of a node, unless it is already in the goal state."""
    table = TRANSITIONS[transition]
    wait_s = timeout_s or TRANSITION_S
    before = _ros_state(ros, node, timeout_s)
    if before == table.goal:
        return Member(node=node, result="already there", state=before)
    answer = ros.change(node, transition, wait_s)
    if answer is not None and answer.success:
        return Member(node=node, result="reached", state=table.goal)
    result: Result = "refused"
    if answer is None:
        result, fault = "timed out", f"no answer to `{transition}` within {wait_s:g} s"
    elif before not in table.starts:
        starts = " or ".join(sorted(table.starts))
        fault = f"`{transition}` requires state {starts}, but the node is {before}"
    else:
        fault = f"`{transition}` failed: {answer.fault or 'the node gave no reason'}"
    return Member(node=node, result=result, state=_ros_state(ros, node, timeout_s), fault=fault)
