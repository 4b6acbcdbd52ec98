"""The recorder of a stack: nodes wait for it, and its failure is only a warning."""

import json
import signal
from collections.abc import Callable
from pathlib import Path
from typing import cast

from obk_cli.launch.console import Output
from obk_cli.launch.event_lines import LaunchReport
from obk_cli.launch.events import (
    Ended,
    EventBus,
    OutputEvent,
    OutputLine,
    ProcessEnded,
    ProcessStarted,
)
from obk_cli.launch.process_groups import Unit
from obk_cli.launch.processes import WardenProcesses
from obk_cli.launch.recorder import UNIT, Recorder
from obk_cli.record.recorder_job import BEGUN, RecordRequest

from .shown import Shown

ENDED = Ended(exit_code=0, cause="")
PROCESS = {
    "node": "n",
    "namespace": "/",
    "section": "robot",
    "device": "",
    "package": "p",
    "executable": "e",
    "origin": {"path": "c.yaml", "line": 1, "column": 1},
    "publishes": [{"topic": "/a", "msg_type": "x/msg/A"}],
    "subscribes": [],
}
PLAN = {"name": "x", "processes": [PROCESS]}


class Processes:
    """Stores the requests; a signal ends the recorder immediately."""

    def __init__(self) -> None:
        self.started: list[str] = []
        self.signals: list[int] = []
        self.on_event: Callable[[ProcessEnded], None] = lambda _: None

    def start(self, unit: Unit) -> None:
        self.started.append(unit.name)

    def signal(self, process: str, number: int) -> None:
        assert process == UNIT.name
        self.signals.append(number)
        self.on_event(ProcessEnded(process=UNIT.name, code=0))


class World:
    """A recorder, and all objects that it uses."""

    def __init__(self, request: RecordRequest | None, folder: Path | None) -> None:
        self.screen = Shown()
        output = Output(None, self.screen, LaunchReport((), colour=False, quiet=True), ())
        self.recorder = Recorder(request, folder, output)
        self.lines = EventBus[OutputLine]()
        self.lines.subscribe(output.line)
        self.lines.subscribe(self.recorder.on_line)
        self.events = EventBus[OutputEvent]()
        self.events.subscribe(self.recorder.on_event)
        self.published: list[OutputEvent] = []
        self.events.subscribe(self.published.append)
        self.processes = Processes()
        self.processes.on_event = self.recorder.on_process_event

    def start(self) -> None:
        self.recorder.commands({})
        self.recorder.start(cast(WardenProcesses, self.processes))


def run_folder(folder: Path) -> Path:
    (folder / "run.json").write_text(json.dumps({"name": "x", "plan": PLAN}), encoding="utf-8")
    return folder


def test_a_launch_that_records_nothing_has_no_recorder() -> None:
    world = World(None, None)
    world.start()
    world.recorder.wait_until_started()
    world.events.publish(ENDED)
    assert not world.processes.started
    assert world.published == [ENDED]
    assert not world.screen.lines


def test_the_topics_of_the_plan_are_recorded_by_default(tmp_path: Path) -> None:
    folder = run_folder(tmp_path)
    (command,) = World(RecordRequest(), folder).recorder.commands({"A": "b"}).values()
    job = json.loads(Path(command.arguments[-1]).read_text(encoding="utf-8"))
    assert job["request"]["topics"] == {"/a": "x/msg/A"}
    assert job["path"] == str(folder / "recording.mcap")
    assert command.environment == {"A": "b"}
    (command,) = World(RecordRequest(patterns=("/b*",)), folder).recorder.commands({}).values()
    job = json.loads(Path(command.arguments[-1]).read_text(encoding="utf-8"))
    assert job["request"] == {"topics": {}, "patterns": ["/b*"], "excludes": []}


def test_the_nodes_wait_until_the_recording_has_started(tmp_path: Path) -> None:
    world = World(RecordRequest(), run_folder(tmp_path))
    world.start()
    world.recorder.on_process_event(ProcessStarted(process=UNIT.name, pid=1))
    world.recorder.on_process_event(ProcessEnded(process="/node", code=1))
    world.lines.publish(OutputLine(process="/node", text=BEGUN))
    assert not world.recorder._has_started.is_set()
    world.lines.publish(OutputLine(process=UNIT.name, text=f"{BEGUN}here"))
    assert world.screen.lines[-1] == f"{BEGUN}here"
    world.recorder.wait_until_started()
    assert len(world.screen.lines) == 2


def test_the_recording_ends_before_the_end_of_the_run_is_reported(tmp_path: Path) -> None:
    world = World(RecordRequest(), run_folder(tmp_path))
    world.start()
    world.events.publish(ENDED)
    assert world.processes.signals == [signal.SIGINT]
    assert world.published == [ENDED]
    assert not world.screen.lines


def test_a_recorder_that_dies_is_reported_and_the_stack_continues(tmp_path: Path) -> None:
    world = World(RecordRequest(), run_folder(tmp_path))
    world.start()
    world.recorder.on_process_event(ProcessEnded(process=UNIT.name, code=1, text="no space left"))
    world.recorder.wait_until_started()
    world.events.publish(ENDED)
    assert not world.processes.signals
    (line,) = world.screen.lines
    assert line.startswith("warning: the recorder stopped: the process exited with code 1: no sp")
