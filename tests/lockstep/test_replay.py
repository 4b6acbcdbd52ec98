"""Replay of recorded inputs: the same code gives the same result, in any order of inputs."""

import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from obelisk_estimator_msgs.msg import EstimatedState

from obelisk_recordings.chunks import messages_in_order
from obelisk_recordings.run import open_run
from obk_cli.errors import CommandFailedError
from obk_cli.record.compare import first_different_message
from obk_cli.record.mcap_writer import BagWriter
from obk_cli.record.recorder import installed_definition
from obk_testing.recording import write_recording
from obk_testing.replay import ReplayRequest, replay
from obk_testing.trial import Schedule, StackTrial

pytestmark = pytest.mark.ros

WORKSPACE = Path(__file__).parent / "workspace"
CONFIG = WORKSPACE / "hazards.yaml"
VIEWS, ENCODERS, EST = "/hazards/views", "/hazards/joint_encoders", "/hazards/est"
REVERSED = WORKSPACE / "reversed.yaml"
CONTROL, ESTIMATION, ROBOT = "/obelisk_control_0", "/obelisk_estimation_0", "/obelisk_robot_0"

Start = Callable[..., StackTrial]


def request_for(trial: StackTrial, node: str, recording: Path) -> ReplayRequest:
    processes = {one.full_name: one for one in trial.stack.plan.nodes}
    recorded = {one.topic for one in open_run(recording).bag.topics if one.count}
    published = {end.topic for end in processes[node].publishes}
    subscribed = {end.topic for end in processes[node].subscribes}
    return ReplayRequest(
        config=str(trial.stack.config),
        overrides=(),
        without=tuple(name for name in processes if name != node),
        recording=str(recording),
        inputs=tuple(sorted((subscribed - published) & recorded)),
        outputs=tuple(sorted(published & recorded)),
        output=str(recording.with_name("again.mcap")),
    )


@pytest.mark.parametrize("node", [CONTROL, ESTIMATION, ROBOT])
@pytest.mark.parametrize("config", [CONFIG, REVERSED], ids=["forward", "reversed"])
@pytest.mark.parametrize(
    "schedule",
    [
        Schedule(),
        Schedule(latency=0.0007, jitter=0.0009, compute={CONTROL: 0.0004}),
        Schedule(bring_up={ESTIMATION: 0.013}),
    ],
    ids=["ideal", "late", "bring-up"],
)
def test_a_node_publishes_the_recorded_messages_again(
    start_config: Start, tmp_path: Path, config: Path, node: str, schedule: Schedule
) -> None:
    recording = tmp_path / "trial.mcap"
    trial = start_config(config, schedule=schedule, seed=3)
    write_recording(recording, trial.run(0.5), {})
    request = request_for(trial, node, recording)
    assert request.inputs
    assert request.outputs
    assert list(replay(request)) == []
    first, second = open_run(recording), open_run(request.output)
    for topic in request.outputs:
        found = first_different_message(first, second, topic)
        assert found.at_s is None, f"{topic} differs at {found.at_s} s"
        assert found.count > 10
    if VIEWS in second.topics:  # the values that the controller received; the last column is random
        np.testing.assert_array_equal(first[VIEWS].data[:, :3], second[VIEWS].data[:, :3])


BEGIN_NS = 1_700_000_000_000_000_000


def as_launched(path: Path, *, is_simulated: bool) -> Path:
    """Give a recording made in lockstep the times of a launch: at half speed, or in wall time."""
    run = open_run(path)
    plan = json.loads(run.attachments["plan.json"])
    for process in plan["processes"]:
        process["parameters"]["use_sim_time"] = is_simulated
    launched = path.with_name("launched.mcap")
    with BagWriter(launched) as writer:
        writer.describe({}, {"plan.json": json.dumps(plan)}, 0)
        for name in (ENCODERS, EST):
            text = run[name].messages.definition
            channel = writer.add_topic(name, run[name].msg_type, text, {})
            for number, one in enumerate(messages_in_order(path, [name])):
                time_ns = BEGIN_NS + one.published_ns * (2 if is_simulated else 1)
                stamp_ns = one.published_ns + (0 if is_simulated else BEGIN_NS)
                stamp = struct.pack("<iI", *divmod(stamp_ns, 1_000_000_000))
                data = one.data[:4] + stamp + one.data[12:]
                writer.add_message(channel, data, time_ns, time_ns, number)
    return launched


@pytest.mark.parametrize("is_simulated", [True, False], ids=["simulated", "wall"])
def test_a_launch_is_replayed_on_the_clock_of_its_nodes(
    start_config: Start, tmp_path: Path, is_simulated: bool
) -> None:
    recording = tmp_path / "trial.mcap"
    trial = start_config(CONFIG)
    write_recording(recording, trial.run(0.5), {})
    request = request_for(trial, ESTIMATION, as_launched(recording, is_simulated=is_simulated))
    assert list(replay(request)) == []
    first, again = open_run(recording), open_run(request.output)
    fed = again[ENCODERS]
    # The first stamp is 0, which counts as not set.
    assert fed.stamps[1:] == pytest.approx(fed.t[1:], abs=1e-6)
    assert abs(len(again[EST]) - len(first[EST])) <= 1
    np.testing.assert_array_equal(fed.y, first[ENCODERS].y)


def test_a_node_that_fails_is_an_error_with_its_messages_until_then(
    start_config: Start, tmp_path: Path
) -> None:
    recording = tmp_path / "trial.mcap"
    trial = start_config(CONFIG)
    trial.run(0.5)
    trial.publish("/hazards/est", EstimatedState())
    write_recording(recording, trial.run(0.5), {})
    request = request_for(trial, CONTROL, recording)
    with pytest.raises(CommandFailedError, match="IndexError"):
        list(replay(request))
    assert 40 < len(open_run(request.output)["/hazards/ctrl"]) < 60


def test_messages_with_a_different_definition_are_rejected(
    start_config: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = tmp_path / "trial.mcap"
    trial = start_config(CONFIG)
    write_recording(recording, trial.run(0.1), {})
    request = request_for(trial, CONTROL, recording)

    def other_definition(package: str, name: str) -> str | None:
        text = installed_definition(package, name)
        return text and text.replace("float64[] q_joints", "float32[] q_joints")

    monkeypatch.setattr("obk_testing.replay.installed_definition", other_definition)
    with pytest.raises(CommandFailedError, match="the definition of obelisk_estimator_msgs"):
        list(replay(request))
