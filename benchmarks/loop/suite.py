"""All cases in turns, round by round, so that whatever else the machine does falls on all."""

import os
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import psutil

from benchmarks.loop.cases import Case
from benchmarks.loop.figures import Figures
from benchmarks.loop.run import SETTLE_S, Failed, measure

__all__ = ["Load", "Run", "Suite", "estimate_s", "run_suite"]

LOOK_S = 1.0
"""How long the machine's load is looked at before a round [s]."""
START_AND_END_S = 1.0
START_OF_A_PROCESS_S = 0.6
"""What a quiet machine takes [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Load:
    """How busy the machine was before a round, while nothing of the suite ran."""

    busy_percent: float
    """Of all cores together."""
    load_average: float
    """Over a minute, so the round before is in it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One case in one round."""

    case: Case
    round: int
    outcome: Figures | Failed


@dataclass(frozen=True, slots=True, kw_only=True)
class Suite:
    """All that was measured."""

    seconds: float
    loads: tuple[Load, ...]
    """Before each round."""
    runs: tuple[Run, ...]


def estimate_s(cases: Sequence[Case], *, rounds: int, seconds: float) -> float:
    """How long a suite takes on a quiet machine, about [s]."""
    one_round_s = sum(
        START_AND_END_S + START_OF_A_PROCESS_S * len(case.processes) + SETTLE_S + seconds
        for case in cases
    )
    return rounds * (LOOK_S + one_round_s)


def run_suite(
    cases: Sequence[Case],
    *,
    rounds: int,
    seconds: float,
    floor: Path,
    told: Callable[[Run], None],
) -> Suite:
    """Run all cases once in each round; a round begins with another case than the one before.

    Args:
        cases: what runs.
        rounds: how often.
        seconds: how long each run is measured.
        floor: the compiled C program.
        told: hears of each run when it is over.
    """
    loads: list[Load] = []
    runs: list[Run] = []
    for number in range(rounds):
        loads.append(_load())
        first = number * len(cases) // rounds
        for case in (*cases[first:], *cases[:first]):
            with tempfile.TemporaryDirectory(prefix="obk-loop-") as folder:
                outcome = measure(case, seconds=seconds, floor=floor, folder=Path(folder))
            runs.append(Run(case=case, round=number, outcome=outcome))
            told(runs[-1])
    return Suite(seconds=seconds, loads=tuple(loads), runs=tuple(runs))


def _load() -> Load:
    time.sleep(0.1)  # for what the round before has left
    return Load(busy_percent=psutil.cpu_percent(LOOK_S), load_average=os.getloadavg()[0])
