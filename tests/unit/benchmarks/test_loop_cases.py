"""The loop benchmark runs what it says, each case once a round, and tells all of it."""

import json
from pathlib import Path

from benchmarks.loop.cases import BASELINE, CONTESTANTS, FLOOR, LAYOUTS, PARTS, Case, cases_of
from benchmarks.loop.figures import Figures
from benchmarks.loop.plots import draw_curve
from benchmarks.loop.report import rows_of, table, write_json, write_table
from benchmarks.loop.run import Failed
from benchmarks.loop.suite import Load, Run, Suite


def figures(cpu_percent: float) -> Figures:
    return Figures(
        cpu_percent=cpu_percent,
        cpu_per_tick_us=cpu_percent,
        others_percent=0.0,
        rate_hz=1000.0,
        late_p50_us=20.0,
        late_p99_us=2 * cpu_percent,
        latency_p50_ms=1.0,
        latency_p99_ms=2.0,
    )


def suite(*runs: Run, busy_percent: float = 1.0) -> Suite:
    load = Load(busy_percent=busy_percent, load_average=0.5)
    return Suite(seconds=4.0, loads=(load,), runs=runs)


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


def test_figures_of_a_busy_machine_are_marked(tmp_path: Path) -> None:
    for busy_percent, is_quiet in ((1.0, True), (80.0, False)):
        measured = suite(run(BASELINE, figures(100.0)), busy_percent=busy_percent)
        write_json(tmp_path / "loop.json", measured)
        write_table(tmp_path / "loop.md", measured)
        assert json.loads((tmp_path / "loop.json").read_text())["is_quiet"] is is_quiet
        assert ("prove nothing" in (tmp_path / "loop.md").read_text()) is not is_quiet


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
