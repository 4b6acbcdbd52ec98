"""Run all cases in turns, round by round, so that other load on the machine affects all of them.

Each finished run goes to the journal, so that an interrupted suite can be resumed, and parts
measured separately can be merged.
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
"""Time to measure the machine's load before a round, followed by a second of a bare timer [s]."""
START_AND_END_S = 1.0
START_OF_A_PROCESS_S = 0.6
"""Startup time of a process on an idle machine [s]."""
FURTHER_ROUNDS = 2
FURTHER_SHARE = 0.1
"""Fraction of a suite's duration for repeating runs that the host disturbed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Load:
    """The load of the machine before a round, while the suite was idle."""

    busy_percent: float
    """In percent of all cores together."""
    load_average: float
    """Over one minute, so it includes the previous round."""
    bare_late_p99_us: float
    """Lateness of a 1 kHz timer without work."""
    bare_stolen_percent: float
    """Time stolen from that timer, in percent of one core; an idle machine would lose none."""


Record = Run | Load
"""A record in the journal."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Suite:
    """All results, without disturbed runs if enough undisturbed ones exist."""

    loads: tuple[Load, ...]
    """One before each round."""
    runs: tuple[Run, ...]
    disturbed: int
    """The number of disturbed runs among all runs."""
    disturbed_and_kept: int


def suite_of(efforts: Mapping[Case, Effort], records: Sequence[Record]) -> Suite:
    """Collect the results from the records of some cases."""
    runs = tuple(record for record in records if isinstance(record, Run))
    chosen, bad = kept(efforts, runs), disturbed(runs)
    return Suite(
        loads=tuple(record for record in records if isinstance(record, Load)),
        runs=chosen,
        disturbed=len(bad),
        disturbed_and_kept=sum((run.case, run.round) in bad for run in chosen),
    )


def estimate_s(turns: Sequence[Turn]) -> float:
    """The approximate duration of some runs on an idle machine [s]."""
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
    """Make the missing runs, then repeat some of those that the host disturbed.

    Args:
        efforts: the cases, with the number and duration of their runs.
        done: existing runs of these cases.
        floor: the compiled C program.
        keep: called with each load and each finished run.
        reported: called with each run and the approximate remaining time [s].
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
    """As many of the first turns as fit into this time."""
    count = len(turns)
    while count and estimate_s(turns[:count]) > seconds:
        count -= 1
    return turns[:count]


def _run(turn: Turn, floor: Path) -> Run:
    with tempfile.TemporaryDirectory(prefix="obk-loop-") as folder:
        outcome = measure(turn.case, seconds=turn.seconds, floor=floor, folder=Path(folder))
    return Run(case=turn.case, round=turn.round, outcome=outcome)


def _load() -> Load:
    time.sleep(0.1)  # until the previous round has settled
    busy_percent, load_average = psutil.cpu_percent(LOOK_S), os.getloadavg()[0]
    bare = bare_second()
    return Load(
        busy_percent=busy_percent,
        load_average=load_average,
        bare_late_p99_us=bare.late_p99_us,
        bare_stolen_percent=bare.stolen_percent,
    )
