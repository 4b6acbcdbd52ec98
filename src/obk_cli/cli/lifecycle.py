"""`obk lifecycle get|list|configure|activate|deactivate|cleanup|shutdown [NODE...]`."""

import json
import sys
from collections.abc import Iterator, Mapping
from typing import Annotated

import typer

from obelisk_spec.suggestions import did_you_mean
from obk_cli.cli.options import FormatOption, require_positive, wants_json
from obk_cli.errors import EXIT_DONE, EXIT_FAILED, MisuseError
from obk_cli.introspect.lifecycle import (
    LifecycleRequest,
    change_states,
    node_states,
    possible_transitions,
)
from obk_cli.launch.stack_state import GONE
from obk_cli.launch.transitions import UNKNOWN
from obk_cli.ros.environment import ros_environment
from obk_cli.runs.lifecycle import RESTING, TRANSITIONS
from obk_cli.runs.protocol import ChangeAnswer, Member, change_data
from obk_cli.runs.registry import NO_ANSWER
from obk_cli.terminal import plain

__all__ = ["EXAMPLE", "SUBCOMMANDS", "command"]

EXAMPLE = "Example: obk lifecycle deactivate obelisk_control_0"
SUBCOMMANDS = ("get", "list", *TRANSITIONS)
"""The first argument of `obk lifecycle`."""
_RESULTS = {"already there": "already in that state"}
"""Result -> its text, if that differs."""
WITHOUT_STATE = frozenset({NO_ANSWER, UNKNOWN, GONE})
"""Shown instead of a state for nodes that reported none."""


def command(
    verb: Annotated[
        str, typer.Argument(metavar="|".join(SUBCOMMANDS), help="Transition or query.")
    ],
    nodes: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NODE...]", help="Node names or sections. Default: all nodes."),
    ] = None,
    run: Annotated[
        str | None,
        typer.Option(metavar="RUN", help="Stack, by the name of its config or run folder."),
    ] = None,
    timeout: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Seconds to wait for a node's answer or transition. Default: as launched, or 10.",
        ),
    ] = None,
    format: FormatOption = "text",
) -> None:
    """Show the states of a running stack's nodes, or trigger a transition.

    NODE is a name, full or short (control_0), or a section (control). `list` shows the transitions
    that are possible now. configure and activate start with the robot, the others with the
    controllers. Nodes already in the target state are skipped. If one fails, the others are rolled
    back. Exit code 0: every node reached the state; 1: one did not, or does not exist.
    """
    if verb not in SUBCOMMANDS:
        raise MisuseError(
            f"`obk lifecycle {verb}`: unknown transition", help=did_you_mean(verb, SUBCOMMANDS)
        )
    require_positive("--timeout", timeout, "a number of seconds")
    is_json = wants_json(format)
    request = LifecycleRequest(names=tuple(nodes or ()), run=run, timeout_s=timeout)
    environment = ros_environment()
    if verb in TRANSITIONS:
        answer = change_states(environment, verb, request)
        _report_change(answer, is_json=is_json)
        raise typer.Exit(EXIT_DONE if answer.success else EXIT_FAILED)
    states = node_states(environment, request)
    if verb == "get":
        _report_states(states, is_json=is_json)
    else:
        _report_possible(states, is_json=is_json)
    raise typer.Exit(EXIT_FAILED if WITHOUT_STATE & set(states.values()) else EXIT_DONE)


def _report_states(states: Mapping[str, str], *, is_json: bool) -> None:
    shown = map(plain, _columns(states))
    print(json.dumps(states, indent=1) if is_json else "\n".join(shown))


def _report_possible(states: Mapping[str, str], *, is_json: bool) -> None:
    possible = {node: possible_transitions(state) for node, state in states.items()}
    if is_json:
        document = {n: {"state": states[n], "transitions": list(t)} for n, t in possible.items()}
        print(json.dumps(document, indent=1))
        return
    rows = {
        node: f"{states[node]:<12}  {', '.join(transitions) or _no_transition(states[node])}"
        for node, transitions in possible.items()
    }
    print("\n".join(map(plain, _columns(rows))))


def _no_transition(state: str) -> str:
    return "none (final state)" if state in RESTING else "none now"


def _report_change(answer: ChangeAnswer, *, is_json: bool) -> None:
    if not answer.success:
        print(f"error: {plain(answer.why.splitlines()[0] if answer.why else '')}", file=sys.stderr)
    if is_json:
        print(json.dumps(change_data(answer), indent=1))
        return
    # The node at fault first, as in the error message.
    members = sorted(answer.members, key=lambda member: not member.is_culprit)
    width = max((len(member.node) for member in members), default=0)
    for member in members:
        print("\n".join(map(plain, _member(member, width))))


def _member(member: Member, width: int) -> Iterator[str]:
    text = _RESULTS.get(member.result, member.result)
    result = "" if member.result == "reached" else f"  {text}"
    yield f"{member.node:<{width}}  {member.state}{result}"
    for line in member.fault.splitlines():
        yield f"    {line}"


def _columns(rows: Mapping[str, str]) -> Iterator[str]:
    width = max(map(len, rows), default=0)
    return (f"{name:<{width}}  {row}" for name, row in rows.items())
