"""Replay of recorded inputs: the same code gives the same result, in any order of inputs."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from obelisk_estimator_msgs.msg import EstimatedState

from obelisk_recordings.run import open_run
from obk_cli.errors import CommandFailedError
from obk_cli.record.compare import first_different_message
from obk_cli.record.recorder import installed_definition
from obk_testing.recording import write_recording
from obk_testing.replay import ReplayRequest, replay
from obk_testing.trial import Schedule, StackTrial

pytestmark = pytest.mark.ros

WORKSPACE = Path(__file__).parent / "workspace"
CONFIG = WORKSPACE / "hazards.yaml"
VIEWS = "/hazards/views"
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
        count, differs_s = first_different_message(first, second, topic)
        assert differs_s is None, f"{topic} differs at {differs_s} s"
        assert count > 10
    if VIEWS in second.topics:  # the values that the controller received; the last column is random
        np.testing.assert_array_equal(first[VIEWS].data[:, :3], second[VIEWS].data[:, :3])


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
