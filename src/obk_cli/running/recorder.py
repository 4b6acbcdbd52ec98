"""The recorder of a run: a process beside the nodes, begun before them and ended after them.

It is no part of the stack: when it fails, that is told and the stack goes on. In: what to record.
Out: `recording.mcap` in the run's folder.
"""

import signal
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from obk_cli.adapters.processes import NodeCommand, WardenProcesses
from obk_cli.emit.write import STATE_MODE, write_text
from obk_cli.launch.events import Ended, Heard, ProcessEnded, ProcessStarted, Told
from obk_cli.launch.units import Unit
from obk_cli.recording.choice import Wish
from obk_cli.recording.find import RECORDING
from obk_cli.recording.job import BEGUN, Job, job_to_json
from obk_cli.recording.made_from import background_of
from obk_cli.running.output import Output
from obk_cli.runs.run_plan import run_topics

__all__ = ["UNIT", "Recorder"]

BEGIN_S: Final = 5.0
"""How long the nodes wait for the recorder [s]."""
END_S: Final = 5.0
"""How long it may take for the last messages and the index [s]."""
UNIT: Final = Unit(name="/recorder", nodes=())
PROGRAM: Final = "obk_cli.adapters.record"


class Recorder:
    """Stands between a run's processes and those who hear of them."""

    def __init__(self, wish: Wish | None, folder: Path | None, output: Output) -> None:
        """Prepare a recording.

        Args:
            wish: what to record, without topics and patterns the plan's; None: nothing.
            folder: the run's, with all that is told of the run; None: there is none.
            output: takes what the recorder says.
        """
        self._wish = wish
        self._folder = folder
        self._output = output
        self._processes: WardenProcesses | None = None
        self._has_begun = threading.Event()
        self._has_ended = threading.Event()
        self._has_command = False
        self._is_ending = False

    def commands(self, environment: Mapping[str, str]) -> Mapping[str, NodeCommand]:
        """How the recorder is started, in this environment; empty where nothing is recorded."""
        if self._wish is None:
            return {}
        if self._folder is None:
            self._output.note("warning: nothing is recorded: there is no folder for it")
            return {}
        path = self._folder / "recording.json"
        try:
            job = job_to_json(self._job(self._folder, self._wish))
            write_text(path, job, mode=STATE_MODE)
        except OSError as error:
            self._output.note(f"warning: nothing is recorded: {error}")
            return {}
        self._has_command = True
        # -P: what lies in the working folder is no library.
        arguments = (sys.executable, "-P", "-m", PROGRAM, str(path))
        return {UNIT.name: NodeCommand(arguments=arguments, environment=environment)}

    def start(self, processes: WardenProcesses) -> None:
        """Start the process where `commands` has given a command for it."""
        if self._has_command:
            self._processes = processes
            processes.start(UNIT)

    def wait_until_begun(self) -> None:
        """Wait until the recorder listens, or has failed; the nodes come up after that."""
        if self._processes is not None and not self._has_begun.wait(BEGIN_S):
            self._output.note(f"warning: the recorder has not begun after {BEGIN_S:g} s")

    def hearing(self, others: Callable[[Heard], None]) -> Callable[[Heard], None]:
        """Take news of the recorder's process out of what others hear."""

        def hear(heard: Heard) -> None:
            is_ours = (
                isinstance(heard, ProcessStarted | ProcessEnded) and heard.process == UNIT.name
            )
            if not is_ours:
                others(heard)
            elif isinstance(heard, ProcessEnded):
                self._ended(heard)

        return hear

    def lines(self, others: Callable[[str, str], None]) -> Callable[[str, str], None]:
        """Take the recorder's lines out of those of the nodes."""

        def line(unit: str, text: str) -> None:
            if unit != UNIT.name:
                others(unit, text)
                return
            self._output.journal.line(unit, text)
            self._output.note(text)
            if text.startswith(BEGUN):
                self._has_begun.set()

        return line

    def telling(self, others: Callable[[Told], None]) -> Callable[[Told], None]:
        """End the recording when the run has ended, before others are told so."""

        def tell(told: Told) -> None:
            if isinstance(told, Ended):
                self._end()
            others(told)

        return tell

    def _job(self, folder: Path, wish: Wish) -> Job:
        is_named = bool(wish.topics or wish.patterns)
        background = background_of(folder)
        return Job(
            path=folder / RECORDING,
            wish=wish if is_named else replace(wish, topics=run_topics(folder)),
            metadata=background.metadata,
            attachments=background.attachments,
        )

    def _end(self) -> None:
        self._is_ending = True
        if self._processes is None or self._has_ended.is_set():
            return
        self._processes.signal(UNIT.name, signal.SIGINT)
        if not self._has_ended.wait(END_S):
            self._output.note(f"warning: the recorder does not end within {END_S:g} s")

    def _ended(self, end: ProcessEnded) -> None:
        self._has_ended.set()
        self._has_begun.set()
        if not self._is_ending or end.code:
            self._output.note(f"warning: the recorder has ended: {end.how}; the stack goes on")
