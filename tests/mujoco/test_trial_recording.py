"""The file of a trial can be read by `obk bag`, `obk plot` and `close_to`."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from std_msgs.msg import Float64

from obelisk_py.core.lockstep.interception import LogEntry
from obelisk_py.core.lockstep.topics import Topic
from obelisk_recordings.run import open_run
from obelisk_recordings.summary import read_bag
from obk_cli.plan.plan import Plan
from obk_testing.plot import draw_trial, signals_of
from obk_testing.recording import STATE_TOPIC, write_recording
from obk_testing.result import Intervention, StateLog, TrialFacts, TrialResult

from .two_joints import ARM

pytestmark = pytest.mark.mujoco
MS = 1_000_000


@pytest.fixture
def result() -> TrialResult:
    return trial()


def trial(step: float = 0.1) -> TrialResult:
    """Three steps, two messages, one line of log."""
    model = mujoco.MjModel.from_xml_string(ARM)
    states = StateLog("/robot", model)
    for number in range(3):
        states.add(number * MS, np.full(model.nq, step * number), np.zeros(model.nv))
    topic = Topic("/x", Float64, is_watched=False)
    topic.log = [(n * MS, n, topic.codec.pack(Float64(data=float(n)))) for n in range(2)]
    entry = LogEntry(time_ns=MS, severity=40, name="robot", text="no", place="robot.py:7")
    return TrialResult(
        facts=TrialFacts(
            config=Path("stack.yaml"),
            plan=Plan(name="stack", nodes=()),
            seed=3,
            interventions=(Intervention(t=0.001, duration=float("inf"), text="drop /x"),),
        ),
        duration_s=0.002,
        topics={"/x": topic},
        states=states,
        faults=("robot: no",),
        notes=(),
        log=(entry,),
        ways={},
    )


def test_a_recording_contains_the_trial(result: TrialResult, tmp_path: Path) -> None:
    path = tmp_path / "trial.mcap"
    path.write_text("of an earlier run")
    write_recording(path, result, {"test": "t.py::test_x"})
    bag = read_bag(path)
    assert {topic.topic: topic.count for topic in bag.topics} == {
        "/x": 2,
        "/rosout": 1,
        STATE_TOPIC: 3,
    }
    about = bag.metadata["obelisk"]
    assert (about["seed"], about["digest"]) == ("3", result.digest())
    assert about["test"] == "t.py::test_x"
    assert {"cpu", "hash_seed"} <= bag.metadata["obelisk_machine"].keys()
    assert bag.attachments.keys() == {
        "plan.json",
        "schedule.json",
        "interventions.json",
        "faults.json",
        "notes.json",
    }


def test_its_log_has_simulated_time(result: TrialResult, tmp_path: Path) -> None:
    write_recording(tmp_path / "trial.mcap", result, {})
    log = open_run(tmp_path / "trial.mcap")["/rosout"]
    assert [log.level.tolist(), log.msg.tolist(), log.line.tolist()] == [[40], ["no"], [7]]
    assert log.messages.published_ns == log.stamp.nanosec == MS


def test_a_golden_recording_is_compared(result: TrialResult, tmp_path: Path) -> None:
    golden = tmp_path / "golden.mcap"
    write_recording(golden, result, {})
    assert result.close_to(golden, atol=0.0, fields=["/x.data"])
    difference = repr(trial(step=0.2).close_to(golden, atol=0.1))
    assert difference == "qpos[0] differs by 0.2 at 0.002 s, more than 0.1"
    with pytest.raises(LookupError, match="no topic `/y`"):
        result.close_to(golden, atol=0.1, fields=["/y.data"])


def test_a_missing_golden_recording_is_named(result: TrialResult, tmp_path: Path) -> None:
    with pytest.raises(LookupError, match=r"none\.mcap"):
        result.close_to(tmp_path / "none.mcap", atol=0.1)


def test_the_picture_shows_the_view_of_the_test(result: TrialResult, tmp_path: Path) -> None:
    assert [signal.name for signal in signals_of(result)] == ["qpos"]
    _ = result["/x"].data
    result.facts.looked_at.pop(("qpos",), None)
    assert [signal.name for signal in signals_of(result)] == ["/x.data"]
    path = tmp_path / "trial.svg"
    assert draw_trial(result, "test_x", path)
    text = path.read_text()
    assert "drop /x" in text
    assert "/x.data" in text


def test_a_field_without_numbers_is_not_drawn(result: TrialResult) -> None:
    result.facts.looked_at[("/x", "nothing")] = None
    result.facts.looked_at[("/nowhere", "data")] = None
    assert signals_of(result) == ()


def test_attachments_are_valid_json(result: TrialResult, tmp_path: Path) -> None:
    """An intervention without an end ends with the trial."""
    from mcap.reader import make_reader

    write_recording(tmp_path / "trial.mcap", result, {})
    with (tmp_path / "trial.mcap").open("rb") as file:
        texts = {a.name: a.data for a in make_reader(file).iter_attachments()}
    (intervention,) = json.loads(texts["interventions.json"])
    assert intervention == {"t": 0.001, "duration": 0.001, "text": "drop /x"}
