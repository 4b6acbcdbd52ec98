"""Decide the order of runs, which runs are repeated, and which count. Pure.

A run is compared with the quietest run of its own case only. Stolen time grows with the number of
wake-ups of a case; one limit for all would repeat busy cases and pick their best runs until they
look good.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from benchmarks.loop.cases import Case, Effort
from benchmarks.loop.figures import Figures
from benchmarks.stolen import DISTURBED_PERCENT

__all__ = ["Failed", "Run", "Turn", "disturbed", "kept", "to_repeat", "turns_of"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Failed:
    """A run without figures."""

    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """A run to make."""

    case: Case
    round: int
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One case in one round."""

    case: Case
    round: int
    outcome: Figures | Failed


def turns_of(efforts: Mapping[Case, Effort], done: Iterable[Run] = ()) -> tuple[Turn, ...]:
    """Each case once in each of its rounds, except for existing runs.

    Each round starts with a different case.
    """
    there = {(run.case, run.round) for run in done}
    cases, rounds = tuple(efforts), max((e.rounds for e in efforts.values()), default=0)
    turns = []
    for number in range(rounds):
        first = number * len(cases) // rounds
        for case in (*cases[first:], *cases[:first]):
            if number < efforts[case].rounds and (case, number) not in there:
                turns.append(Turn(case=case, round=number, seconds=efforts[case].seconds))
    return tuple(turns)


def disturbed(runs: Sequence[Run]) -> frozenset[tuple[Case, int]]:
    """Case and round of the runs that the host disturbed."""
    least: dict[Case, float] = {}
    for case, _, stolen in _stolen(runs):
        least[case] = min(stolen, least.get(case, stolen))
    return frozenset(
        (case, number)
        for case, number, stolen in _stolen(runs)
        if stolen > least[case] + DISTURBED_PERCENT
    )


def to_repeat(efforts: Mapping[Case, Effort], runs: Sequence[Run]) -> tuple[Turn, ...]:
    """One more round: the cases with a disturbed run that has no replacement yet.

    Each is preceded by its baseline, because ratios are computed within a round.
    """
    bad = disturbed(runs)
    good = [run for run in runs if (run.case, run.round) not in bad]
    lacking = [
        case
        for case, effort in efforts.items()
        if any(case == found for found, _ in bad)
        and sum(run.case == case for run in good) < effort.rounds
    ]
    pairs = (each for case in lacking for each in (case.baseline, case) if each in efforts)
    number = 1 + max((run.round for run in runs), default=-1)
    return tuple(
        Turn(case=case, round=number, seconds=efforts[case].seconds)
        for case in dict.fromkeys(pairs)
    )


def kept(efforts: Mapping[Case, Effort], runs: Sequence[Run]) -> tuple[Run, ...]:
    """The runs that count: undisturbed runs, and if they are too few, the least disturbed ones."""
    bad = disturbed(runs)
    chosen = {(run.case, run.round) for run in runs} - bad
    for case, effort in efforts.items():
        lacking = effort.rounds - sum(found == case for found, _ in chosen)
        own = sorted((stolen, number) for found, number, stolen in _stolen(runs) if found == case)
        spare = [number for _, number in own if (case, number) in bad]
        chosen |= {(case, number) for number in spare[: max(0, lacking)]}
    return tuple(run for run in runs if (run.case, run.round) in chosen)


def _stolen(runs: Iterable[Run]) -> list[tuple[Case, int, float]]:
    return [
        (run.case, run.round, run.outcome.stolen_percent)
        for run in runs
        if isinstance(run.outcome, Figures)
    ]
