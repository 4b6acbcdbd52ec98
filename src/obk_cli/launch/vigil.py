"""Watches a stack that is up: makes the changes that are asked for, deals with crashes."""

from obk_cli.launch.asks import ChangeAsked
from obk_cli.launch.change import Change, make_change
from obk_cli.launch.hearing import FROM_ELSEWHERE, Hearing
from obk_cli.launch.recovery import Recovery
from obk_cli.runs.lifecycle import FINALIZED, TRANSITIONS
from obk_cli.runs.protocol import ChangeAnswer

__all__ = ["keep_vigil"]


def keep_vigil(hearing: Hearing, recovery: Recovery, until: float | None) -> None:
    """Watch until something ends the run, or until a time.

    Args:
        hearing: the run.
        recovery: what brings crashed nodes back.
        until: monotonic time [s]; None: for ever.
    """
    roster = hearing.roster
    hearing.watch(node for node in roster.with_lifecycle if roster.is_present(node))
    if hearing.lead is not None:
        hearing.lifecycle.watch({hearing.lead})
    idle = "" if hearing.lead is None else "led from another device"
    while hearing.may_go_on:
        if hearing.crashes:
            hearing.busy_with = "bringing back a node that crashed"
            recovery.deal_with_crashes()
        elif hearing.asked:
            hearing.busy_with = "in the middle of another change"
            asked = hearing.asked.popleft()
            asked.reply(_answer(hearing, asked))
        else:
            hearing.busy_with = idle
            if hearing.hear(until) is None:
                return


def _answer(hearing: Hearing, asked: ChangeAsked) -> ChangeAnswer:
    """Make a change that was asked for."""
    roster = hearing.roster
    unknown = sorted(set(asked.nodes) - roster.with_lifecycle)
    if unknown:
        why = f"no such node with a life cycle is driven here: {', '.join(unknown)}"
        return ChangeAnswer(success=False, why=why)
    if asked.transition not in TRANSITIONS:
        return ChangeAnswer(success=False, why=f"there is no transition `{asked.transition}`")
    lost = sorted(set(asked.nodes) & roster.lost)
    if lost:
        return ChangeAnswer(success=False, why=f"crashed, and not brought back: {', '.join(lost)}")
    answer = make_change(
        hearing,
        Change(
            transition=TRANSITIONS[asked.transition],
            nodes=frozenset(asked.nodes) or frozenset(roster.counted()),
            limit_s=asked.timeout_s or hearing.limits.transition_s,
        ),
    )
    if roster.are_all(roster.counted(), FINALIZED):
        hearing.stop = hearing.stop or FROM_ELSEWHERE
    return answer
