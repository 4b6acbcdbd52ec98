"""`obk lifecycle get|configure|activate|deactivate|cleanup|shutdown [NODE...]`."""

import json
import sys
from collections.abc import Mapping
from typing import Annotated

import typer

from obelisk_spec.near import did_you_mean
from obk_cli.adapters.live_runs import live_runs
from obk_cli.adapters.ros_environment import RosEnvironment, ros_environment
from obk_cli.adapters.ros_lifecycle import RosLifecycle, open_ros
from obk_cli.errors import EXIT_DONE, EXIT_FAILED, CommandFailedError, MisuseError
from obk_cli.launch.order import in_tier_order, section_of
from obk_cli.launch.runs import Run, runs_folder
from obk_cli.launch.transitions import TRANSITIONS

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: obk lifecycle deactivate obelisk_control_0"
VERBS = ("get", *TRANSITIONS)
DISCOVERY_S = 3.0
"""For nodes that are known to run [s]."""
NOTHING_S = 1.0
"""After which there is nothing [s]."""
QUIET_S = 0.5
ANSWER_S = 2.0
"""For a node's state [s]."""
NO_ANSWER = "no answer"


def command(
    verb: Annotated[str, typer.Argument(metavar="|".join(VERBS), help="What to do.")],
    nodes: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NODE...]", help="Nodes by name; all when none is named."),
    ] = None,
    timeout: Annotated[float, typer.Option(help="Seconds that a transition may take.")] = 10.0,
    format: Annotated[str, typer.Option(metavar="text|json", help="How to report.")] = "text",
) -> None:
    """Ask for the states of a running stack's nodes, or take them through a transition.

    NODE is a name, full or short (control_0), or a section (control). Up (configure, activate)
    goes robot first, down goes controllers first; a node that is there already is left alone.
    Exit code 0: every node got there; 1: one did not, or there is no such node.
    """
    if verb not in VERBS:
        raise MisuseError(f"`obk lifecycle {verb}`: no such verb", help=did_you_mean(verb, VERBS))
    if format not in ("text", "json"):
        raise MisuseError(f"`--format {format}`: expected `text` or `json`")
    environment = ros_environment()
    with open_ros("obk_lifecycle", environment) as ros:
        chosen = _choose(ros, environment, nodes or ())
        if verb == "get":
            states = {node: _state(ros, node, timeout) for node in chosen}
            done = NO_ANSWER not in states.values()
        else:
            states, done = _change(ros, verb, chosen, timeout)
    _report(states, format)
    raise typer.Exit(EXIT_DONE if done else EXIT_FAILED)


def _choose(
    ros: RosLifecycle, environment: RosEnvironment, asked: list[str] | tuple[str, ...]
) -> tuple[str, ...]:
    """The nodes meant, in tier order, once they are in the graph."""
    runs = live_runs(runs_folder(environment.variables))
    expected = [node for run in runs if run.domain == environment.domain for node in run.nodes]
    wanted = expected or _full(asked)
    # A node of a live run that is not found is there nevertheless: it does not answer.
    seen = ros.find(wanted, DISCOVERY_S if wanted else NOTHING_S, QUIET_S)
    found = tuple(dict.fromkeys((*seen, *expected)))
    if not found:
        raise CommandFailedError(
            f"there is no life-cycle node in the ROS domain {environment.domain}",
            help=_where_else(runs),
        )
    if not asked:
        return in_tier_order(expected or found)
    for name in asked:
        if not _matches(name, found):
            raise CommandFailedError(
                f"there is no life-cycle node '{name}' in the ROS domain {environment.domain}",
                help=did_you_mean(name, found),
            )
    return in_tier_order({node for name in asked for node in _matches(name, found)})


def _where_else(runs: tuple[Run, ...]) -> str:
    """What to do when there is nothing in this ROS domain."""
    domains = sorted({run.domain for run in runs})
    if domains:
        where = " and ".join(map(str, domains))
        return f"a stack runs in the ROS domain {where}; set ROS_DOMAIN_ID"
    return (
        "start a stack with `obk launch`; a stack on another host needs "
        "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET here and there"
    )


def _state(ros: RosLifecycle, node: str, timeout: float) -> str:
    return ros.state(node, min(timeout, ANSWER_S)) or NO_ANSWER


def _full(asked: list[str] | tuple[str, ...]) -> list[str]:
    return [name for name in asked if name.startswith("/")]


def _matches(name: str, found: tuple[str, ...]) -> tuple[str, ...]:
    """The nodes that a user means by a name, full or in short, or by a section's name."""
    tails = (f"/{name.lstrip('/')}", f"/obelisk_{name.lstrip('/')}")
    by_name = tuple(node for node in found if node.endswith(tails))
    return by_name or tuple(node for node in found if section_of(node) == name)


def _change(
    ros: RosLifecycle, verb: str, nodes: tuple[str, ...], timeout: float
) -> tuple[dict[str, str], bool]:
    """Take nodes to a transition's goal, one after another; stops at the first that stays away."""
    goal = TRANSITIONS[verb].goal
    states: dict[str, str] = {}
    for node in nodes if verb in ("configure", "activate") else reversed(nodes):
        if _state(ros, node, timeout) != goal:
            refusal = _refusal(ros, verb, node, timeout)
            if refusal is not None:
                print(f"{node}: {refusal}", file=sys.stderr)
                states[node] = _state(ros, node, timeout)
                return states, False
        states[node] = goal
    return states, True


def _refusal(ros: RosLifecycle, verb: str, node: str, timeout: float) -> str | None:
    """Ask for a transition; why it was not made, or None when it was."""
    before = _state(ros, node, timeout)
    answer = ros.change(node, verb, timeout)
    if answer is None:
        return f"no answer to '{verb}' within {timeout:g} s"
    if answer.success:
        return None
    if before not in TRANSITIONS[verb].starts:
        starts = " or ".join(sorted(TRANSITIONS[verb].starts))
        return f"'{verb}' starts from {starts}, and the node is {before}"
    return f"'{verb}' failed: {answer.fault or 'the node gave no reason'}"


def _report(states: Mapping[str, str], format: str) -> None:
    if format == "json":
        print(json.dumps(states, indent=1))
        return
    width = max(map(len, states), default=0)
    for node, state in states.items():
        print(f"{node:<{width}}  {state}")
