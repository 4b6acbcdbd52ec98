"""Requests of a viewer: checked against the model, carried out between steps, logged."""

import json
import math
from typing import Any

import mujoco
import numpy as np
import pytest

from obelisk_py.core.sim.mujoco.viewers.viewer_requests import (
    PauseRequest,
    PushRequest,
    Report,
    Request,
    RequestError,
    ResetRequest,
    SpeedRequest,
    StepRequest,
    read_report,
    read_request,
    report_text,
    request_text,
)

from .viewer_host import Viewable

pytestmark = pytest.mark.mujoco

FLOATING = """
<mujoco>
  <option gravity="0 0 0" timestep="0.01"/>
  <worldbody>
    <body name="post"><geom size="0.1"/></body>
    <body name="ball" pos="0 0 1"><freejoint/><geom size="0.1" mass="2"/></body>
  </worldbody>
  <keyframe><key name="high" qpos="0 0 5 1 0 0 0"/></keyframe>
</mujoco>
"""
PUSH = PushRequest(body="ball", force=(0.0, 20.0, 0.0), duration_s=0.1)


@pytest.fixture
def viewable() -> Viewable:
    return Viewable(mujoco.MjModel.from_xml_string(FLOATING))


def ask(viewable: Viewable, request: Request) -> Report:
    return viewable.controls.answer(request_text(request))


@pytest.mark.parametrize(
    "request_",
    [
        PauseRequest(is_paused=True),
        StepRequest(),
        ResetRequest(keyframe="high"),
        ResetRequest(keyframe=None),
        SpeedRequest(realtime_factor=0.5),
        PUSH,
    ],
)
def test_a_request_arrives_as_it_was_sent(viewable: Viewable, request_: Request) -> None:
    assert read_request(request_text(request_), viewable.model) == request_


def test_a_report_arrives_as_it_was_sent() -> None:
    report = Report(state="inactive", is_paused=True, realtime_factor=0.0, answer="no")
    assert read_report(report_text(report)) == report


def push(**changes: Any) -> dict[str, Any]:
    valid = {"request": "push", "body": "ball", "force": [1, 2, 3], "duration_s": 0.1}
    return {**valid, **changes}


@pytest.mark.parametrize(
    "data",
    [
        [],
        {},
        {"request": "fly"},
        {"request": "pause"},
        {"request": "pause", "is_paused": 1},
        {"request": "reset", "keyframe": "low"},
        {"request": "reset", "keyframe": 3},
        {"request": "speed"},
        {"request": "speed", "realtime_factor": 0},
        {"request": "speed", "realtime_factor": 1e9},
        {"request": "speed", "realtime_factor": math.nan},
        {"request": "speed", "realtime_factor": True},
        push(body="bal"),
        push(body="post"),
        push(body="world"),
        push(body=None),
        push(force=[1, 2]),
        push(force="123"),
        push(force=[1, 2, math.inf]),
        push(force=[1, 2, 10**400]),
        push(force=[0, 0, 0]),
        push(force=[1e4, 1e4, 0]),
        push(duration_s=0),
        push(duration_s=-1),
        push(duration_s=1e6),
        push(duration_s="1"),
    ],
)
def test_an_invalid_request_is_answered_and_changes_nothing(viewable: Viewable, data: Any) -> None:
    with pytest.raises(RequestError):
        read_request(json.dumps(data), viewable.model)
    report = viewable.controls.answer(json.dumps(data))
    assert not report.is_done
    assert report.answer
    viewable.simulation.advance()
    assert viewable.log == []
    assert not viewable.simulation.data.qvel.any()


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, "\0"])
def test_a_packet_that_is_no_json_is_rejected(viewable: Viewable, text: str) -> None:
    assert not viewable.controls.answer(text).is_done


def test_a_wrong_name_is_answered_with_the_nearest_one(viewable: Viewable) -> None:
    assert "`ball`" in viewable.controls.answer(json.dumps(push(body="bal"))).answer


def test_steps_are_taken_only_while_paused(viewable: Viewable) -> None:
    assert not ask(viewable, StepRequest()).is_done
    assert ask(viewable, PauseRequest(is_paused=True)).is_paused
    assert ask(viewable, StepRequest()).is_done
    assert viewable.simulation.steps == 1
    assert not ask(viewable, PauseRequest(is_paused=False)).is_paused


@pytest.mark.parametrize("state", ["unconfigured", "inactive", "finalized"])
def test_a_robot_that_is_not_active_does_nothing_and_gives_the_reason(
    viewable: Viewable, state: str
) -> None:
    viewable.state = state
    for request in (PauseRequest(is_paused=True), ResetRequest(keyframe="high"), PUSH):
        report = ask(viewable, request)
        assert (report.is_done, report.state) == (False, state)
        assert "not active" in report.answer
    assert viewable.log == []
    assert not viewable.queue.is_paused


def test_a_push_acts_for_its_duration_and_is_logged(viewable: Viewable) -> None:
    data = viewable.simulation.data
    assert ask(viewable, PUSH).answer == "push of 20 N on ball for 0.1 s"
    for _ in range(20):
        viewable.simulation.advance()
    # 20 N for 0.1 s on 2 kg
    assert np.allclose(data.qvel[:3], [0.0, 1.0, 0.0])
    assert not data.xfrc_applied.any()
    assert viewable.log == [
        "push of 20 N on ball for 0.1 s from the viewer, at 0 s, force (0, 20, 0) N in the "
        "world frame"
    ]


def test_pushes_add_up_and_a_batch_of_steps_ends_them_in_time(viewable: Viewable) -> None:
    ask(viewable, PUSH)
    ask(viewable, PushRequest(body="ball", force=(0.0, 20.0, 0.0), duration_s=0.05))
    viewable.simulation.advance(20)
    assert np.allclose(viewable.simulation.data.qvel[:3], [0.0, 1.5, 0.0])


def test_a_reset_ends_pushes(viewable: Viewable) -> None:
    ask(viewable, PUSH)
    viewable.simulation.advance(2)
    assert ask(viewable, ResetRequest(keyframe="high")).is_done
    viewable.simulation.advance(20)
    assert viewable.simulation.data.qpos[:3].tolist() == [0.0, 0.0, 5.0]
    assert ask(viewable, ResetRequest(keyframe=None)).is_done
    assert viewable.simulation.data.qpos[2] == 1.0


def test_everything_that_is_done_is_logged(viewable: Viewable) -> None:
    ask(viewable, PauseRequest(is_paused=True))
    ask(viewable, StepRequest())
    ask(viewable, SpeedRequest(realtime_factor=0.5))
    ask(viewable, ResetRequest(keyframe="high"))
    ask(viewable, PauseRequest(is_paused=False))
    assert viewable.log == [
        "simulation paused from the viewer, at 0 s",
        "one step from the viewer, at 0.01 s",
        "speed 0.5 from the viewer, at 0.01 s",
        "reset to the keyframe high from the viewer, at 0 s",
        "simulation continued from the viewer, at 0 s",
    ]
