"""All cases in turns, round by round, so that whatever else the machine does falls on all.

Each run goes to the journal when it is over. So a suite that was interrupted goes on where it was,
and parts that were measured apart are joined.
"""

import os
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import psutil

from benchmarks.bare_timer import bare_second
from benchmarks.loop.cases import Case, Effort
from benchmarks.loop.run import SETTLE_S, measure
from benchmarks.loop.turns import Run, Turn, disturbed, kept, to_repeat, turns_of

__all__ = ["Load", "Record", "Suite", "estimate_s", "run_suite", "suite_of"]

LOOK_S = 1.0
"""How long the machine's load is looked at before a round [s], before a bare timer's second."""
START_AND_END_S = 1.0
START_OF_A_PROCESS_S = 0.6
"""What a quiet machine takes [s]."""
FURTHER_ROUNDS = 2
FURTHER_SHARE = 0.1
"""Of the time of a suite, for runs that the host disturbed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Load:
    """How the machine was before a round, while nothing of the suite ran."""

    busy_percent: float
    """Of all cores together."""
    load_average: float
    """Over a minute, so the round before is in it."""
    bare_late_p99_us: float
    """How late a timer of 1 kHz was that does nothing."""
    bare_stolen_percent: float
    """What the host took meanwhile, of one core: of an idle machine nothing can be taken."""


Record = Run | Load
"""What the journal keeps."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Suite:
    """All that was measured, with what the host disturbed left out where there is better."""

    loads: tuple[Load, ...]
    """Before each round."""
    runs: tuple[Run, ...]
    disturbed: int
    """Of all runs that were made."""
    disturbed_and_kept: int


def suite_of(efforts: Mapping[Case, Effort], records: Sequence[Record]) -> Suite:
    """What the records of some cases come to."""
    runs = tuple(record for record in records if isinstance(record, Run))
    chosen, bad = kept(efforts, runs), disturbed(runs)
    return Suite(
        loads=tuple(record for record in records if isinstance(record, Load)),
        runs=chosen,
        disturbed=len(bad),
        disturbed_and_kept=sum((run.case, run.round) in bad for run in chosen),
    )


def estimate_s(turns: Sequence[Turn]) -> float:
    """How long some runs take on a quiet machine, about [s]."""
    rounds = {turn.round for turn in turns}
    return len(rounds) * (LOOK_S + 1.0) + sum(map(_estimate_s, turns))


def _estimate_s(turn: Turn) -> float:
    starts_s = START_OF_A_PROCESS_S * len(turn.case.processes)
    return START_AND_END_S + starts_s + SETTLE_S + turn.seconds


def run_suite(
    efforts: Mapping[Case, Effort],
    done: Sequence[Run],
    *,
    floor: Path,
    keep: Callable[[Record], None],
    reported: Callable[[Run, float], None],
) -> None:
    """Make the runs that are not done, then repeat some of those that the host disturbed.

    Args:
        efforts: what runs, how often and how long.
        done: the runs of these cases that are there.
        floor: the compiled C program.
        keep: takes each load and each run when it is over.
        reported: called with each run and with the time that is left for all [s], about.
    """
    runs = list(done)

    def make(turns: Sequence[Turn]) -> None:
        number = -1
        for place, turn in enumerate(turns):
            if turn.round != number:
                keep(_load())
                number = turn.round
            run = _run(turn, floor)
            runs.append(run)
            keep(run)
            reported(run, estimate_s(turns[place + 1 :]))

    make(turns_of(efforts, done))
    end_s = time.monotonic() + FURTHER_SHARE * estimate_s(turns_of(efforts))
    for _ in range(FURTHER_ROUNDS):
        make(_within(to_repeat(efforts, runs), end_s - time.monotonic()))


def _within(turns: Sequence[Turn], seconds: float) -> Sequence[Turn]:
    """The first of them, as many as can be made in this time."""
    count = len(turns)
    while count and estimate_s(turns[:count]) > seconds:
        count -= 1
    return turns[:count]


def _run(turn: Turn, floor: Path) -> Run:
    with tempfile.TemporaryDirectory(prefix="obk-loop-") as folder:
        outcome = measure(turn.case, seconds=turn.seconds, floor=floor, folder=Path(folder))
    return Run(case=turn.case, round=turn.round, outcome=outcome)


def _load() -> Load:
    time.sleep(0.1)  # for what the round before has left
    busy_percent, load_average = psutil.cpu_percent(LOOK_S), os.getloadavg()[0]
    bare = bare_second()
    return Load(
        busy_percent=busy_percent,
        load_average=load_average,
        bare_late_p99_us=bare.late_p99_us,
        bare_stolen_percent=bare.stolen_percent,
    )
