"""The loop benchmark runs what it says, each case once a round, and tells all of it."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.loop.cases import BASELINE, CONTESTANTS, FLOOR, LAYOUTS, PARTS, Case, cases_of
from benchmarks.loop.figures import Figures
from benchmarks.loop.plots import draw_curve
from benchmarks.loop.report import disturbances, rows_of, table, write_json, write_table
from benchmarks.loop.suite import Load, Suite
from benchmarks.loop.turns import Failed, Run

from .measured import figures


def suite(*runs: Run, busy_percent: float = 1.0, stolen_percent: float = 0.0) -> Suite:
    load = Load(
        busy_percent=busy_percent,
        load_average=0.5,
        bare_late_p99_us=70.0,
        bare_stolen_percent=stolen_percent,
    )
    return Suite(loads=(load,), runs=runs, disturbed=3, disturbed_and_kept=1)


def run(contestant: str, outcome: Figures | Failed, layout: str = "composed") -> Run:
    return Run(case=Case(contestant=contestant, layout=layout), round=0, outcome=outcome)


def test_separate_nodes_have_a_process_each_and_composed_ones_share_one() -> None:
    names = ("sim_0", "est_0", "ctrl_0", "sim_1", "est_1", "ctrl_1")
    case = Case(contestant=FLOOR, layout="separate", nodes=6)
    assert case.processes == tuple((name,) for name in names)
    assert Case(contestant=FLOOR, layout="composed", nodes=6).processes == (names,)


def test_every_case_is_there_once_with_its_baseline() -> None:
    cases = cases_of(PARTS, CONTESTANTS, LAYOUTS)
    assert len(cases) == len(set(cases))
    assert {case.baseline for case in cases} <= set(cases)
    assert {case.contestant for case in cases_of(["work"], CONTESTANTS, LAYOUTS)} == {*CONTESTANTS}


def test_a_row_has_its_ratio_or_why_it_failed() -> None:
    rows = rows_of(
        suite(
            run(BASELINE, figures(100.0)),
            run(FLOOR, figures(6.0)),
            run("obelisk executor", Failed(why="a process died: no such thing")),
        )
    )
    lines = table(rows)
    assert "| 6.00 | 0.0600 | 6.00 |" in lines[-1]
    assert "failed: a process died: no such thing" in lines[-2]


@pytest.mark.parametrize(
    ("busy_percent", "stolen_percent", "is_quiet"),
    [(1.0, 0.5, True), (80.0, 0.5, False), (1.0, 9.0, False)],
)
def test_figures_of_a_machine_that_is_busy_or_stolen_from_are_marked(
    busy_percent: float, stolen_percent: float, is_quiet: bool, tmp_path: Path
) -> None:
    measured = suite(
        run(BASELINE, figures(100.0)), busy_percent=busy_percent, stolen_percent=stolen_percent
    )
    write_json(tmp_path / "loop.json", measured)
    write_table(tmp_path / "loop.md", measured)
    assert json.loads((tmp_path / "loop.json").read_text())["is_quiet"] is is_quiet
    assert ("prove nothing" in (tmp_path / "loop.md").read_text()) is not is_quiet


def test_the_head_of_the_table_tells_what_was_stolen_and_how_many_runs_were_disturbed() -> None:
    measured = suite(run(BASELINE, figures(100.0)), run(FLOOR, figures(6.0)), stolen_percent=2.0)
    before, during, disturbed = disturbances(measured)
    assert before.endswith("70.0 us late (p99), with 2.00 % of a core stolen")
    assert during.startswith("stolen by the host during runs: 0 % of a core, from C on rcl 0 %")
    assert disturbed.startswith("3 runs had 5 % of a core more stolen than the quietest run")
    assert "; 1 of them count all the same" in disturbed
    *_, none = disturbances(replace(measured, disturbed=0, disturbed_and_kept=0))
    assert none == "no runs had 5 % of a core more stolen than the quietest run of the same case"


def test_curves_are_drawn_the_same_from_the_same_figures(tmp_path: Path) -> None:
    runs = [
        Run(case=case, round=0, outcome=figures(float(number)))
        for number, case in enumerate(cases_of(PARTS, CONTESTANTS, LAYOUTS))
    ]
    first, second = (
        draw_curve(tmp_path, "size", rows_of(suite(*runs))).read_bytes() for _ in range(2)
    )
    assert FLOOR.encode() in first
    assert first == second
