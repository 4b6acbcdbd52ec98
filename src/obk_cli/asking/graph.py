"""Asking nodes over the ROS graph: a stack on another host, one that was started by other means."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from obelisk_spec.suggestions import did_you_mean
from obk_cli.adapters.ros_environment import RosEnvironment
from obk_cli.adapters.ros_lifecycle import RosLifecycle, open_ros
from obk_cli.asking.names import NO_ANSWER, in_tier_order, nodes_meant, stack_nodes
from obk_cli.errors import CommandFailedError
from obk_cli.launch.asks import ChangeAnswer, Member, Result
from obk_cli.launch.transitions import TRANSITIONS

__all__ = ["Wanted", "change_in_graph", "states_in_graph"]

DISCOVERY_S: Final = 3.0
"""At least for nodes that are known to run [s]."""
NOTHING_S: Final = 2.0
"""After which there is nothing [s]."""
QUIET_S: Final = 1.0
"""After the last one that was found; of a stack, half of the nodes would be a wrong answer [s]."""
ANSWER_S: Final = 2.0
"""For a node's state where nothing else is said [s]."""
TRANSITION_S: Final = 10.0
"""For one node's transition where nothing else is said [s]."""
UP: Final = ("configure", "activate")
NODE_NAME: Final = "obk_lifecycle"


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """Which nodes are looked for in the graph."""

    names: tuple[str, ...]
    """As a user gives them; none: all of a stack."""
    expected: tuple[str, ...] = ()
    """Full names of nodes that are known to run."""
    if_none: str
    """What to do when there are no nodes at all."""


def states_in_graph(
    environment: RosEnvironment, wanted: Wanted, timeout_s: float | None
) -> Mapping[str, str]:
    """The states of nodes by full name, `no answer` where a node gives none.

    Args:
        environment: of ROS.
        wanted: which nodes.
        timeout_s: for those that are known to run, and for each node's answer [s]; None: not said.

    Raises:
        CommandFailedError: there is no such node, or no ROS.
    """
    with open_ros(NODE_NAME, environment) as ros:
        chosen = _choose(ros, environment, wanted, timeout_s)
        return {node: _state(ros, node, timeout_s) for node in chosen}


def change_in_graph(
    environment: RosEnvironment, transition: str, wanted: Wanted, timeout_s: float | None
) -> ChangeAnswer:
    """Take nodes to a transition's goal one after another; ends at the first that stays away.

    Up goes the robot first, down the controllers. A node that is there already is left alone.

    Args:
        environment: of ROS.
        transition: `activate`, ...
        wanted: which nodes.
        timeout_s: for those that are known to run, and for each node's answer and transition [s];
            None: not said.

    Raises:
        CommandFailedError: there is no such node, or no ROS.
    """
    members: list[Member] = []
    with open_ros(NODE_NAME, environment) as ros:
        chosen = _choose(ros, environment, wanted, timeout_s)
        for node in chosen if transition in UP else reversed(chosen):
            member = _taken(ros, transition, node, timeout_s)
            members.append(member)
            if member.is_culprit:
                why = f"{node}: {member.fault}"
                return ChangeAnswer(success=False, why=why, members=tuple(members))
    return ChangeAnswer(success=True, members=tuple(members))


def _choose(
    ros: RosLifecycle, environment: RosEnvironment, wanted: Wanted, timeout_s: float | None
) -> tuple[str, ...]:
    """The nodes meant, in tier order, once they are in the graph."""
    awaited = wanted.expected or tuple(name for name in wanted.names if name.startswith("/"))
    is_any = bool(awaited) or bool(ros.find((), NOTHING_S, 0.0))
    find_s = max(DISCOVERY_S, timeout_s or 0.0) if awaited else DISCOVERY_S
    seen = ros.find(awaited, find_s, QUIET_S) if is_any else ()
    # A node of a live run that is not found is there nevertheless: it does not answer.
    found = tuple(dict.fromkeys((*seen, *wanted.expected)))
    if not found:
        raise CommandFailedError(
            f"there is no life-cycle node in the ROS domain {environment.domain}",
            help=wanted.if_none,
        )
    if not wanted.names:
        return in_tier_order(wanted.expected) or stack_nodes(found)
    for name in wanted.names:
        if not nodes_meant(name, found):
            raise CommandFailedError(
                f"there is no life-cycle node `{name}` in the ROS domain {environment.domain}",
                help=did_you_mean(name, found),
            )
    return in_tier_order({node for name in wanted.names for node in nodes_meant(name, found)})


def _state(ros: RosLifecycle, node: str, timeout_s: float | None) -> str:
    return ros.state(node, timeout_s or ANSWER_S) or NO_ANSWER


def _taken(ros: RosLifecycle, transition: str, node: str, timeout_s: float | None) -> Member:
    """Ask a node for a transition, unless it is there already."""
    table = TRANSITIONS[transition]
    wait_s = timeout_s or TRANSITION_S
    before = _state(ros, node, timeout_s)
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
        fault = f"`{transition}` starts from {starts}, and the node is {before}"
    else:
        fault = f"`{transition}` failed: {answer.fault or 'the node gave no reason'}"
    return Member(node=node, result=result, state=_state(ros, node, timeout_s), fault=fault)
