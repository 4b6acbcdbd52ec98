"""The recorder of a run: a process that starts before the nodes and exits after them.

It is not part of the stack: if it fails, a warning is logged and the stack continues. It writes
`recording.mcap` in the run's folder.
"""

import signal
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from obelisk_recordings.find import RECORDING
from obelisk_spec.suggestions import list_names
from obk_cli.files import STATE_MODE, write_text
from obk_cli.launch.console import Output
from obk_cli.launch.events import Ended, OutputEvent, OutputLine, Phase, ProcessEnded, VideoReported
from obk_cli.launch.options import simulated_robots
from obk_cli.launch.process_groups import Share, Unit
from obk_cli.launch.processes import NodeCommand, ProcessEvent, WardenProcesses
from obk_cli.plan.plan import Plan
from obk_cli.record.recorder_job import (
    BEGUN,
    RecorderJob,
    RecordRequest,
    job_to_json,
    run_metadata_of,
)
from obk_cli.runs.folder import topics_of_run

__all__ = ["UNIT", "Recorder", "VideoReports"]

START_S: Final = 5.0
"""Limit for the recorder to start; the nodes wait for it [s]."""
END_S: Final = 5.0
"""Limit for writing the last messages and the index [s]."""
UNIT: Final = Unit(name="/recorder", nodes=())
PROGRAM: Final = "obk_cli.record.recorder"


class Recorder:
    """Starts and stops the recording; subscribes to the events of the run."""

    def __init__(self, request: RecordRequest | None, folder: Path | None, output: Output) -> None:
        """Prepare a recording.

        Args:
            request: what to record, by default the plan's topics; None: nothing.
            folder: the run's folder, with its description; None if it has none.
            output: receives messages about the recording.
        """
        self._request = request
        self._folder = folder
        self._output = output
        self._processes: WardenProcesses | None = None
        self._has_started = threading.Event()
        self._has_ended = threading.Event()
        self._has_command = False
        self._is_ending = False

    def commands(self, environment: Mapping[str, str]) -> Mapping[str, NodeCommand]:
        """The command of the recorder; empty if nothing is recorded."""
        if self._request is None or self._folder is None:
            return {}
        path = self._folder / "recording.json"
        try:
            job = job_to_json(self._job(self._folder, self._request))
            write_text(path, job, mode=STATE_MODE)
        except OSError as error:
            self._output.note(f"warning: nothing is recorded: {error}")
            return {}
        self._has_command = True
        # -P: files in the working folder must not shadow libraries.
        arguments = (sys.executable, "-P", "-m", PROGRAM, str(path))
        return {UNIT.name: NodeCommand(arguments=arguments, environment=environment)}

    def start(self, processes: WardenProcesses) -> None:
        """Start the process if `commands` returned a command for it."""
        if self._has_command:
            self._processes = processes
            processes.start(UNIT)

    def wait_until_started(self) -> None:
        """Wait until the recorder has subscribed or failed; then the nodes are brought up."""
        if self._processes is not None and not self._has_started.wait(START_S):
            self._output.note(f"warning: the recorder did not start within {START_S:g} s")

    def on_process_event(self, event: ProcessEvent) -> None:
        """Record that the recorder's process has ended."""
        if event.process == UNIT.name and isinstance(event, ProcessEnded):
            self._ended(event)

    def on_line(self, line: OutputLine) -> None:
        """Record that the recording has started."""
        if line.process == UNIT.name and line.text.startswith(BEGUN):
            self._has_started.set()

    def on_event(self, event: OutputEvent) -> None:
        """Stop the recording when the run ends, before later subscribers receive `Ended`."""
        if isinstance(event, Ended):
            self._end()

    def _job(self, folder: Path, request: RecordRequest) -> RecorderJob:
        is_named = bool(request.topics or request.patterns)
        background = run_metadata_of(folder)
        return RecorderJob(
            path=folder / RECORDING,
            request=request if is_named else replace(request, topics=topics_of_run(folder)),
            metadata=background.metadata,
            attachments=background.attachments,
        )

    def _end(self) -> None:
        self._is_ending = True
        if self._processes is None or self._has_ended.is_set():
            return
        self._processes.signal(UNIT.name, signal.SIGINT)
        if not self._has_ended.wait(END_S):
            self._output.note(f"warning: the recorder did not stop within {END_S:g} s")

    def _ended(self, end: ProcessEnded) -> None:
        self._has_ended.set()
        self._has_started.set()
        if not self._is_ending or end.code:
            self._output.note(f"warning: the recorder stopped: {end.how}; the stack continues")


_UNKNOWN: Final = "warning: the robot did not report whether its video was saved"


class VideoReports:
    """Reports the videos of a run's robots; `on_event` subscribes to the run's events."""

    def __init__(self, plan: Plan, share: Share, note: Callable[[str], None]) -> None:
        """Expect a video of each simulated robot that has a `render` parameter.

        Args:
            plan: the whole stack.
            share: the part that runs here.
            note: shows a line to the user.
        """
        robots = simulated_robots(plan, share)
        self._expected = [node for node in robots if node.parameters.get("render")]
        self._note = note
        self._has_started = False
        self._results: list[str] = []

    def on_event(self, event: OutputEvent) -> None:
        """Collect the robots' video reports, and show them when the run has ended."""
        match event:
            case VideoReported(video=video) if video.state == "recording":
                self._has_started = True
            case VideoReported(video=video):
                self._results.append(str(video))
            case Phase(name="active") if self._expected and not self._has_started:
                names = list_names(node.full_name for node in self._expected)
                self._note(f"warning: no video was started, although {names} has `render` set")
            case Ended() if self._has_started:
                for text in self._results or [_UNKNOWN]:
                    self._note(text)
