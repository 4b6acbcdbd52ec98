"""The summary at the end of a test run."""

from collections.abc import Sequence
from types import SimpleNamespace

from obk_testing.summary import (
    TrialRecord,
    record_of,
    rerun_command,
    summary_lines,
    unused_notes,
    used_overrides,
)


def record(seed: int, reason: str = "", **changes: object) -> TrialRecord:
    fields: dict[str, object] = {
        "node_id": f"tests/test_arm.py::test_push[seed{seed}]",
        "seed": seed,
        "simulated_s": 3.0,
        "wall_s": 0.5,
        "trials": 1,
        "schedules": ("varied",) if seed else ("ideal",),
        "outcome": "failed" if reason else "passed",
        "reason": reason,
    }
    return TrialRecord(**(fields | changes))  # type: ignore[arg-type]


def lines(*records: TrialRecord, config: str | None = "arm.yaml", set: Sequence[str] = ()) -> str:
    made = summary_lines(records, config=config, overrides=set, duration_s=75.0, processes=2)
    return "\n".join(made)


def test_trials_of_one_test_are_one_line() -> None:
    text = lines(*(record(seed) for seed in range(4)))
    assert text.splitlines()[0] == "tests/test_arm.py::test_push  4 of 4 passed"


def test_parameters_other_than_the_seed_stay_apart() -> None:
    ids = ("t.py::test_x[seed0-2]", "t.py::test_x[seed1-2]", "t.py::test_x[4-seed0]")
    text = lines(*(record(0, node_id=node_id) for node_id in ids))
    assert "t.py::test_x[2]  2 of 2" in text
    assert "t.py::test_x[4]  1 of 1" in text


def test_the_worst_failure_comes_first_with_its_command() -> None:
    text = lines(
        record(0),
        record(3, "assert 0.02 < 0.01", files=("a.mcap",)),
        record(4, "assert np.float64(0.05) < 0.01", files=("b.mcap", "b.png")),
    )
    assert "1 of 3 passed   worst 0.05 (limit 0.01), seed 4" in text
    assert text.index("b.mcap") < text.index("a.mcap")
    assert "again: obk test arm.yaml --again 'tests/test_arm.py::test_push[seed4]'" in text


def test_a_lower_limit_is_missed_from_below() -> None:
    text = lines(record(1, "assert 2.0 > 3.0"), record(2, "assert 1.0 > 3.0"))
    assert "worst 1 (limit 3), seed 2" in text


def test_many_failures_are_cut_short() -> None:
    text = lines(*(record(seed, "assert x") for seed in range(6)))
    assert text.count("again:") == 3
    assert "  and seed 3, seed 4, seed 5" in text


def test_the_total_names_time_cores_and_schedule() -> None:
    total = lines(record(0), record(1)).splitlines()[-1]
    assert total == (
        "2 trials, 6.0 s simulated in 1 min 15 s on 2 cores; 6.0x real time; "
        "ideal schedule in 1 test, schedule varied by seed in 1 test"
    )


def test_the_command_repeats_overrides_too() -> None:
    command = rerun_command("arm.yaml", ("control.params.kp=50",), "t.py::test_x[seed1]")
    assert command == "obk test arm.yaml --set control.params.kp=50 --again 't.py::test_x[seed1]'"


def test_a_comparison_is_repeated_as_one() -> None:
    command = rerun_command("arm.yaml", (), "t.py::test_x", twice=True)
    assert command == "obk test arm.yaml --twice --again t.py::test_x"


def test_without_obk_test_pytest_repeats_it() -> None:
    command = rerun_command(None, (), "t.py::test_x[seed17]")
    assert command == "pytest -p obk_testing.plugin --seeds =17 't.py::test_x[seed17]'"


def test_a_record_travels_as_a_property() -> None:
    made = record(1, "assert x", files=("a.mcap",))
    report = SimpleNamespace(user_properties=[("other", "1"), made.as_property()])
    assert record_of(report) == made
    assert record_of(SimpleNamespace(user_properties=[])) is None


def test_an_override_that_no_trial_of_a_test_uses_is_noted() -> None:
    assert "note:" in lines(*(record(seed, unused=("a.b",)) for seed in range(2)))
    assert "note:" not in lines(record(0, unused=("a.b",)), record(1))
    assert [*unused_notes("t", [("a", "b"), ("b",)])] == [*unused_notes("t", [("b",)])]


def test_a_test_that_sets_a_value_itself_does_not_use_the_override() -> None:
    settings = ("control.params.kd[1]=3", "robot.x=2")
    assert used_overrides(settings, ()) == {"control.params.kd[1]", "robot.x"}
    for own in ("control.params.kd[1]=4", "control[0].params.kd[1]=4", "control.params={}"):
        assert used_overrides(settings, (own,)) == {"robot.x"}
    others = ("control.params.k=4", "control.params.kd[10]=4", "control.params.kd[1].x=4")
    for other in (*others, "control.params.kd[0]=5", "control[1].params.kd[1]=5"):
        assert len(used_overrides(settings, (other,))) == 2
