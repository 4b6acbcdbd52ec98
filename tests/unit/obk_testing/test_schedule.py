"""Random schedules by seed, and the bring-up of a real run, read from its events."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.plan.plan import Origin, Plan, PlannedNode, PlannedRate
from obk_testing.schedule import Schedule, bring_up_times

BEGIN_S = 1_795_000_000.0


def process(name: str, model: str | None = None) -> PlannedNode:
    return PlannedNode(
        node=name,
        namespace="/",
        section=name,
        device="",
        package="p",
        executable="e",
        origin=Origin(path="walker.yaml", line=1, column=1),
        model=model,
    )


PLAN = Plan(name="walker", nodes=(process("control"), process("robot", "model/walker.xml")))


def write_run(folder: Path, **activated_ms: float) -> Path:
    """A run folder whose nodes became active at these times."""
    folder.mkdir(parents=True)
    events: list[dict[str, object]] = [{"time": BEGIN_S, "event": "Phase", "name": "starting"}]
    for node, after_ms in activated_ms.items():
        for transition, more_ms in (("configure", -5.0), ("activate", 0.0), ("activate", 900.0)):
            events.append(
                {
                    "time": BEGIN_S + (after_ms + more_ms) / 1000,
                    "event": "TransitionEnded",
                    "node": f"/{node}",
                    "transition": transition,
                    "result": "reached",
                    "seconds": 0.004,
                }
            )
    text = "".join(json.dumps(event) + "\n" for event in events)
    (folder / "events.jsonl").write_text(text + '{"time": 1795')  # killed while writing
    return folder


def test_times_count_from_the_middle_of_the_simulators_first_activation(tmp_path):
    run = write_run(tmp_path / "run", robot=10.0, control=28.5)
    expected = {"/control": 0.0205, "/robot": 0.0}
    assert bring_up_times(run, PLAN) == expected
    assert bring_up_times("run/events.jsonl", PLAN, tmp_path) == expected


def test_a_nodes_report_of_its_activation_precedes_the_launchers_view(tmp_path):
    run = write_run(tmp_path / "run", robot=10.0, control=28.5)
    events = (run / "events.jsonl").read_text().rpartition("\n")[0]
    reports = [
        {"time": BEGIN_S + 2, "event": "ActivationReported", "node": node, "simulated_s": time_s}
        for node, time_s in (("/robot", 0.003), ("/control", 0.008), ("/control", 1.2))
    ]
    lines = "\n".join(json.dumps(report) for report in reports)
    (run / "events.jsonl").write_text(f"{events}\n{lines}\n")
    assert bring_up_times(run, PLAN) == {"/control": 0.008, "/robot": 0.0}


@pytest.mark.parametrize(
    ("first_output_s", "start_s"),
    [
        (None, 0.008),
        (0.0085, 0.008),  # from a message, before its first tick
        (0.012, 0.008),
        (0.0159, 0.008),
        (0.016, 0.012),
        (0.021, 0.016),
    ],
)
def test_a_node_without_inputs_begins_with_the_tick_before_its_first_message(
    tmp_path, first_output_s, start_s
):
    run = write_run(tmp_path / "run", robot=10.0, control=28.5)
    events = (run / "events.jsonl").read_text().rpartition("\n")[0]
    report = {"event": "ActivationReported", "node": "/control", "simulated_s": 0.008}
    line = json.dumps({**report, "time": BEGIN_S, "first_output_s": first_output_s})
    (run / "events.jsonl").write_text(f"{events}\n{line}\n")
    origin = Origin(path="walker.yaml", line=1, column=1)
    ticks = PlannedRate(name="timer_ctrl", period_s=0.004, origin=origin, topic="/ctrl")
    other = PlannedRate(name="timer_log", period_s=1.0, origin=origin)
    control, robot = PLAN.nodes
    plan = replace(PLAN, nodes=(replace(control, rates=(ticks, other)), robot))
    assert bring_up_times(run, plan)["/control"] == pytest.approx(start_s, abs=1e-9)


def test_a_node_that_was_active_before_the_simulator_is_active_immediately(tmp_path):
    run = write_run(tmp_path / "run", control=5.0, robot=10.0)
    assert bring_up_times(run, PLAN) == {"/control": 0.0, "/robot": 0.0}


def test_measured_takes_the_latest_whole_run_of_the_stack(tmp_path):
    runs = tmp_path / "runs"
    write_run(runs / "walker_20260101_120000", robot=0.0, control=40.0)
    write_run(runs / "walker_20260102_120000", robot=0.0, control=20.0)
    write_run(runs / "walker_20260103_120000", robot=0.0)  # its controller never became active
    write_run(runs / "other_20260104_120000", robot=0.0, control=10.0)
    (runs / "walker_20260105_120000").mkdir()
    environment = {"OBK_HOME": str(tmp_path)}
    assert bring_up_times("measured", PLAN, environment=environment)["/control"] == 0.022


def test_without_a_run_the_error_names_the_command_that_measures_one(tmp_path):
    with pytest.raises(CommandFailedError) as raised:
        bring_up_times("measured", PLAN, environment={"OBK_HOME": str(tmp_path)})
    assert "obk launch" in str(raised.value.help)


@pytest.mark.parametrize("given", ["nowhere", "run"])
def test_a_path_without_the_nodes_is_an_error(tmp_path, given):
    write_run(tmp_path / "run", robot=0.0)
    with pytest.raises(CommandFailedError):
        bring_up_times(given, PLAN, tmp_path)


def test_given_times_are_kept():
    assert bring_up_times({"control": 0.02}, PLAN) == {"control": 0.02}


NODES = ("/robot", "/estimation", "/control")


def test_seed_0_has_the_ideal_schedule() -> None:
    assert Schedule.varied(0, NODES) == Schedule()


@pytest.mark.parametrize("seed", range(1, 50))
def test_other_seeds_vary_phases_jitter_and_bring_up(seed: int) -> None:
    schedule = Schedule.varied(seed, NODES)
    assert schedule == Schedule.varied(seed, NODES)
    assert schedule.phases
    assert 0.0 <= schedule.jitter <= 0.0003
    assert schedule.bring_up.keys() == set(NODES)
    assert all(0.0 <= start <= 0.02 for start in schedule.bring_up.values())


def test_seeds_draw_different_schedules() -> None:
    drawn = {Schedule.varied(seed, NODES).jitter for seed in range(1, 50)}
    orders = {
        tuple(sorted(NODES, key=Schedule.varied(seed, NODES).bring_up.__getitem__))
        for seed in range(1, 50)
    }
    assert len(drawn) == 49
    assert len(orders) == 6
