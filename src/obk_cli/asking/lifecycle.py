"""States and transitions of running stacks: from their launchers where they run here, else by ROS.

ROS is loaded only when no launcher here can answer, so that an answer does not take longer.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from obk_cli.adapters.ros_environment import RosEnvironment
from obk_cli.errors import CommandFailedError
from obk_cli.runs.control_client import ask_change
from obk_cli.runs.folder import Run, runs_folder
from obk_cli.runs.lifecycle import TRANSITIONS
from obk_cli.runs.protocol import ChangeAnswer, NodeStatus
from obk_cli.runs.registry import live_runs
from obk_cli.runs.stacks import (
    NO_ANSWER,
    Choice,
    choose_stack,
    in_tier_order,
    live_stacks,
    node_statuses,
    runs_meant,
)

__all__ = ["Asked", "change_states", "node_states", "possible_transitions"]

LAUNCHES_OWN_S: Final = 60.0
"""What a launch's own limit is taken for: whoever asks does not know it [s]."""
MARGIN_S: Final = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What a user wants to know about, or change."""

    names: tuple[str, ...] = ()
    """Nodes, full or in short, or sections; none: all."""
    run: str | None = None
    """A config's name or a run folder's; None: whatever runs in the ROS domain."""
    timeout_s: float | None = None
    """For one node's answer or transition [s]; None: the launch's own."""


def node_states(environment: RosEnvironment, asked: Asked) -> Mapping[str, str]:
    """The states of nodes by full name, `no answer` where a node gives none.

    Raises:
        CommandFailedError: there is no such run or node, or no ROS.
    """
    runs = _runs(environment, asked)
    known = node_statuses(live_stacks(runs), asked.names) if runs else None
    if known is not None:
        return {name: _state(known[name]) for name in in_tier_order(known)}

    from obk_cli.asking.graph import Wanted, states_in_graph

    wanted = Wanted(names=asked.names, expected=_nodes(runs), if_none=_if_none(environment))
    return states_in_graph(environment, wanted, asked.timeout_s)


def change_states(environment: RosEnvironment, transition: str, asked: Asked) -> ChangeAnswer:
    """Take nodes through a transition.

    Raises:
        CommandFailedError: there is no such run or node, its launcher does not answer, or no ROS.
        MisuseError: nodes of more than one stack may be meant.
    """
    runs = _runs(environment, asked)
    choice = choose_stack(live_stacks(runs), asked.names)
    if choice is not None:
        return _ask_launcher(choice, transition, asked.timeout_s)

    from obk_cli.asking.graph import Wanted, change_in_graph

    wanted = Wanted(names=asked.names, expected=_nodes(runs), if_none=_if_none(environment))
    return change_in_graph(environment, transition, wanted, asked.timeout_s)


def possible_transitions(state: str) -> tuple[str, ...]:
    """The transitions that a node can be asked for in a state."""
    return tuple(t.name for t in TRANSITIONS.values() if state in t.starts)


def _runs(environment: RosEnvironment, asked: Asked) -> Mapping[Path, Run]:
    return runs_meant(runs_folder(environment.variables), asked.run, domain=environment.domain)


def _state(node: NodeStatus) -> str:
    return NO_ANSWER if node.hangs else node.state


def _ask_launcher(choice: Choice, transition: str, timeout_s: float | None) -> ChangeAnswer:
    stack = choice.stack
    tiers = len({node.section for node in stack.life_cycle_nodes})
    # There and back, tier by tier.
    wait_s = 2 * tiers * (timeout_s or LAUNCHES_OWN_S) + MARGIN_S
    answer = ask_change(stack.folder, transition, choice.nodes, timeout_s=timeout_s, wait_s=wait_s)
    if answer is None:
        raise CommandFailedError(
            f"the launcher of `{stack.run.name}` (process {stack.run.pid}) gave no answer",
            help="see `obk ps` and `obk logs`",
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
        return f"a stack runs in the ROS domain {where}; set ROS_DOMAIN_ID"
    return (
        "start a stack with `obk launch`; a stack on another host needs "
        "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET here and there"
    )
