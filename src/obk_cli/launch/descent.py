"""Brings a stack down: life cycle first, controllers before the robot, then signals.

Goes on whatever the nodes do; what did not end in order is a failure of the run.
"""

import signal
from collections.abc import Iterable

from obk_cli.launch.change import ask_all, learn_states, reason
from obk_cli.launch.hearing import Hearing
from obk_cli.launch.order import tiers_down
from obk_cli.launch.transitions import way_down
from obk_cli.runs.lifecycle import ACTIVE, FINALIZED, Transition
from obk_cli.runs.protocol import Member

__all__ = ["bring_down"]


def bring_down(hearing: Hearing) -> None:
    """Deactivate, clean up, shut down; SIGINT, SIGTERM, SIGKILL."""
    left = frozenset(hearing.roster.in_transition)
    hearing.goes_down()
    hearing.story.phase(
        "stopping", hearing.failures[0].text if hearing.failures else hearing.stop or ""
    )
    hearing.story.is_moving("shuttingdown")
    silent = set(hearing.roster.hung)
    stuck = {hearing.roster.unit_of.get(node, node): node for node in sorted(silent)}
    for node in stuck.values():
        hearing.give_evidence(node)
    for tier in tiers_down(hearing.roster.plan):
        _take_down(hearing, set(tier) & hearing.roster.with_lifecycle, left, silent)
    for unit in {hearing.roster.unit_of[n] for n in silent if hearing.roster.is_here(n)}:
        if not hearing.roster.hung.isdisjoint(hearing.roster.units[unit].node_names):
            hearing.kill(unit)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        _signal_all(hearing, number)
    for unit in sorted(hearing.roster.running):
        hearing.fail(f"{unit}: the process is still there after SIGKILL")
    hearing.story.is_moving(FINALIZED)
    hearing.story.phase("stopped")


def _take_down(
    hearing: Hearing, nodes: Iterable[str], left: frozenset[str], silent: set[str]
) -> None:
    """Take a tier down; what gives no answer joins `silent`, and nothing more is asked of it.

    Args:
        hearing: the run.
        nodes: full names.
        left: those that were in the middle of a transition when the stop was asked for.
        silent: those of which nothing is asked.
    """
    roster = hearing.roster
    there = {n for n in nodes if n in roster.ready - silent and roster.is_present(n)}
    for node in sorted(learn_states(hearing, there)):
        silent.add(node)
        if node not in left and not hearing.is_in_a_hurry:
            limit_s = hearing.limits.answer_s
            hearing.fail(f"{node}: does not tell its state within {limit_s:g} s", node)
    for transition in way_down(ACTIVE):
        if hearing.is_in_a_hurry:
            return
        at = [
            node
            for node in there - silent
            if not roster.is_resting(node) or roster.states[node] in transition.starts
        ]
        # Nodes in the middle of something are asked for everything in turn; what they refuse is
        # no failure.
        lost = {node for node in at if not roster.is_resting(node)}
        for member in ask_all(hearing, transition, at, hearing.limits.down_s).values():
            _judge(hearing, transition, member, lost, silent)


def _judge(
    hearing: Hearing, transition: Transition, member: Member, lost: set[str], silent: set[str]
) -> None:
    node = member.node
    if member.result == "timed out":
        silent.add(node)
    if member.result == "timed out" or (member.result == "refused" and node not in lost):
        hearing.fail(reason(member, transition, hearing.limits.down_s), node)


def _signal_all(hearing: Hearing, number: int) -> None:
    """Send a signal to what still runs, and wait for the ends."""
    for unit in sorted(hearing.roster.running):
        # Before it is ready a node does not handle SIGINT yet, Python does: with a traceback that
        # says nothing.
        early = number == signal.SIGINT and hearing.is_early(unit)
        hearing.processes.signal(unit, signal.SIGTERM if early else number)
    begin = hearing.clock()
    while hearing.roster.running:
        is_short = hearing.is_in_a_hurry and number != signal.SIGKILL
        grace_s = hearing.limits.hurry_s if is_short else hearing.limits.grace_s
        if hearing.hear(begin + grace_s) is None:
            return
