"""Which runs of the loop benchmark are made, made again, and counted."""

from pathlib import Path

from benchmarks.loop.cases import (
    BASELINE,
    CONTESTANTS,
    CURVE,
    FLOOR,
    LAYOUTS,
    LIBRARY,
    PARTS,
    WORK,
    Case,
    Effort,
    cases_of,
    effort_of,
)
from benchmarks.loop.journal import append_record, read_journal, write_journal
from benchmarks.loop.suite import Load, estimate_s, suite_of
from benchmarks.loop.turns import Failed, Run, disturbed, kept, to_repeat, turns_of

from .measured import figures

FLOORS = Case(contestant=FLOOR, layout="composed")
OURS = Case(contestant=LIBRARY, layout="composed")
THEIRS = Case(contestant=BASELINE, layout="composed")
EFFORTS = {case: Effort(rounds=3, seconds=2.0) for case in (THEIRS, OURS, FLOORS)}


def run(case: Case, number: int, stolen_percent: float) -> Run:
    return Run(case=case, round=number, outcome=figures(1.0, stolen_percent))


def rounds(case: Case, *stolen_percents: float) -> list[Run]:
    return [run(case, number, stolen) for number, stolen in enumerate(stolen_percents)]


def test_each_case_has_its_rounds_and_no_round_begins_like_the_one_before() -> None:
    turns = turns_of(EFFORTS)
    assert len(turns) == 9
    assert [turn.case for turn in turns if turn.round == 1] == [OURS, FLOORS, THEIRS]
    more = turns_of({**EFFORTS, FLOORS: Effort(rounds=5, seconds=3.0)})
    assert [turn.case for turn in more if turn.round > 2] == [FLOORS, FLOORS]


def test_what_is_done_is_not_made_again() -> None:
    done = [*rounds(THEIRS, 0.0, 0.0, 0.0), *rounds(OURS, 0.0)]
    assert {(turn.case, turn.round) for turn in turns_of(EFFORTS, done)} == {
        *((FLOORS, number) for number in range(3)),
        (OURS, 1),
        (OURS, 2),
    }


def test_the_work_is_measured_best_and_all_of_it_takes_less_than_half_an_hour() -> None:
    efforts = {case: effort_of(case) for case in cases_of(PARTS, CONTESTANTS, LAYOUTS)}
    assert [case for case in efforts if efforts[case] == WORK] == list(
        cases_of(["work"], CONTESTANTS, LAYOUTS)
    )
    assert WORK.rounds >= 5
    assert CURVE.rounds >= 3
    assert estimate_s(turns_of(efforts)) < 1800


def test_a_run_is_disturbed_by_more_than_the_quietest_of_its_own_case_has_stolen() -> None:
    # Each wake-up has its price: what is always stolen from one contestant is no disturbance.
    runs = [*rounds(THEIRS, 12.0, 13.0, 14.0), *rounds(FLOORS, 0.5, 9.0, 1.0)]
    assert disturbed(runs) == {(FLOORS, 1)}


def test_a_disturbed_run_is_made_again_in_a_round_with_its_baseline() -> None:
    runs = [*rounds(THEIRS, 0.0, 0.0, 0.0), *rounds(OURS, 0.0, 20.0, 0.0), *rounds(FLOORS, 1.0)]
    turns = to_repeat(EFFORTS, runs)
    assert [(turn.case, turn.round) for turn in turns] == [(THEIRS, 3), (OURS, 3)]
    assert not to_repeat(EFFORTS, [*runs, run(THEIRS, 3, 0.0), run(OURS, 3, 1.0)])


def test_undisturbed_runs_count_and_the_least_disturbed_where_they_are_too_few() -> None:
    runs = [*rounds(OURS, 0.0, 30.0, 20.0, 1.0), *rounds(THEIRS, 0.0, 8.0)]
    assert kept(EFFORTS, runs) == (runs[0], runs[2], runs[3], runs[4], runs[5])
    suite = suite_of(EFFORTS, runs)
    assert (suite.disturbed, suite.disturbed_and_kept) == (3, 2)


def test_a_failure_counts() -> None:
    runs = [Run(case=OURS, round=0, outcome=Failed(why="a process died")), *rounds(FLOORS, 0.0)]
    assert kept(EFFORTS, runs) == tuple(runs)


def test_a_journal_gives_back_what_went_in_where_it_can_be_compared(tmp_path: Path) -> None:
    path, surroundings = tmp_path / "build" / "loop.jsonl", {"machine": {"cores": 2}}
    load = Load(busy_percent=1.0, load_average=0.5, bare_late_p99_us=70.0, bare_stolen_percent=0.0)
    failed = Run(case=OURS, round=1, outcome=Failed(why="a process died"))
    assert read_journal(path, surroundings) == ()
    write_journal(path, surroundings, [load, run(OURS, 0, 2.5)])
    append_record(path, failed)
    assert read_journal(path, surroundings) == (load, run(OURS, 0, 2.5), failed)
    assert read_journal(path, {"machine": {"cores": 4}}) == ()
