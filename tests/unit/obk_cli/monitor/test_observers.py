"""Observation of a run whose launcher does not reply; no topic has a subscription."""

import json
import struct
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import pytest

from obk_cli.monitor import observers, topic_watch
from obk_cli.monitor.observers import LocalObserver
from obk_cli.monitor.topic_watch import TopicWatch
from obk_cli.process.identity import this_process
from obk_cli.runs.folder import Run
from obk_cli.runs.protocol import NodeStatus, StackStatus

PID, STARTED = this_process()
ROBOT, JOY = "/obelisk_robot_0", "/joy"
RUN: Final = Run(
    name="dummy",
    pid=PID,
    started=STARTED,
    domain=7,
    config="c.yaml",
    nodes=(ROBOT,),
    other_nodes=(JOY,),
)
LOOK: Final[Any] = SimpleNamespace(name="/obk_look_1", domain=7)
STATUS: Final = StackStatus(
    name="dummy",
    state="active",
    phase="active",
    seconds=3.0,
    nodes=tuple(
        NodeStatus(
            node=name,
            section=section,
            device="onboard",
            state=state,
            process=name,
            pid=PID,
            restarts=2,
            hangs=False,
        )
        for name, section, state in ((ROBOT, "robot", "active"), (JOY, "joystick", ""))
    ),
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "run.json").write_text(json.dumps(asdict(RUN)))
    return tmp_path


def answering(monkeypatch: pytest.MonkeyPatch, status: StackStatus | None) -> None:
    monkeypatch.setattr(observers, "ask_status", lambda _: status)


def test_nodes_of_a_silent_launcher_are_those_of_its_run(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answering(monkeypatch, None)
    view = LocalObserver(folder, RUN, LOOK).view()
    assert not view.has_ended
    assert [(n.node, n.section, n.state, n.pid) for n in view.nodes] == [
        (ROBOT, "robot", "unknown", None),
        (JOY, "", "", None),
    ]


def test_when_the_launcher_stops_to_answer_its_nodes_stay_in_view_without_states(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    watched = LocalObserver(folder, RUN, LOOK)
    answering(monkeypatch, STATUS)
    assert [node.state for node in watched.view().nodes] == ["active", ""]
    answering(monkeypatch, None)
    view = watched.view()
    assert view.state == ""
    assert [(node.state, node.pid, node.restarts) for node in view.nodes] == [
        ("unknown", PID, 2),
        ("", PID, 2),
    ]
    assert all(node.load is not None for node in view.nodes)


def test_a_run_that_has_ended_has_no_nodes(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answering(monkeypatch, None)
    (folder / "run.json").write_text(json.dumps(asdict(replace(RUN, ended=1.0))))
    view = LocalObserver(folder, RUN, LOOK).view()
    assert (view.has_ended, view.nodes) == (True, ())


def test_an_invalid_speed_message_is_skipped() -> None:
    watch = TopicWatch(LOOK)
    for data in (b"", b"\0\1\0\0", b"\0\1\0\0" + bytes(7)):
        watch._take_rtf(0, data)
    assert watch.realtime_factor is None
    watch._take_rtf(0, b"\0\1\0\0" + bytes(6) + b"\xf0\x3f" + b"more")
    assert watch.realtime_factor == 1.0


def test_the_measured_factor_is_the_mean_of_the_latest_and_0_without_any(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [100.0]
    monkeypatch.setattr(topic_watch, "monotonic_s", lambda: now[0])
    watch = TopicWatch(LOOK)
    assert watch.measured_factor("/r/rtf") is None
    for factor in (1.0, 0.4, 0.6, 0.5):
        watch._take_rtf(0, b"\0\1\0\0" + struct.pack("<d", factor), topic="/r/rtf")
        now[0] += 1.0
    assert watch.measured_factor("/r/rtf") == pytest.approx(0.55)
    now[0] += 5.0
    assert watch.measured_factor("/r/rtf") == 0.0
