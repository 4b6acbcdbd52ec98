"""The films of a run as its launch reports them: whether they have begun, and their results.

The simulated robot makes them and logs what becomes of them; those log lines are picked out here,
so that the end of the run shows the result, however much else was logged.
"""

import threading
from typing import Final

from obelisk_spec.near import list_names
from obk_cli.launch.console import Output
from obk_cli.launch.events import Ended, OutputEvent, OutputLine, Phase
from obk_cli.launch.process_groups import Share
from obk_cli.launch.sim_options import simulated_robots
from obk_cli.plan import Plan

__all__ = ["FilmReport"]

_BEGUN: Final = "a film goes to "
_MADE: Final = "film: "
_LOST: Final = "there is no film"
_LOGGER: Final = "]: "
"""Between the logger's name and its message."""
_WAIT_S: Final = 1.0
"""For the last lines of a robot that has ended [s]."""


class FilmReport:
    """Reports the films of a run; subscribes to its lines and events."""

    def __init__(self, plan: Plan, share: Share, output: Output) -> None:
        """Expect a film of each simulated robot that has the parameter `render`.

        Args:
            plan: a whole stack.
            share: the part of it that runs here.
            output: takes messages on films.
        """
        robots = simulated_robots(plan, share)
        self._robots = [node for node in robots if node.parameters.get("render")]
        self._output = output
        # Each robot's lines come on a thread of their own.
        self._lock = threading.Lock()
        self._begun = 0
        self._results: list[str] = []
        self._has_all = threading.Event()

    def on_line(self, line: OutputLine) -> None:
        """Pick out what robots log of their films."""
        if self._robots:
            with self._lock:
                self._note(line.text)

    def on_end(self, event: OutputEvent) -> None:
        """Report the results when the run has ended; subscribe before what shows the end."""
        if isinstance(event, Ended) and self._begun:
            self._has_all.wait(_WAIT_S)
            for text in self._results or ["warning: what has become of the film was not told"]:
                self._output.note(text)

    def on_active(self, event: OutputEvent) -> None:
        """Warn of missing films when the stack is active; subscribe after what shows that."""
        is_active = isinstance(event, Phase) and event.name == "active"
        if is_active and self._begun < len(self._robots):
            names = list_names(node.full_name for node in self._robots)
            self._output.note(f"warning: no film has begun, which `render` asks for of {names}")

    def _note(self, text: str) -> None:
        if _BEGUN in text:
            self._begun += 1
            self._has_all.clear()
        message = text.rpartition(_LOGGER)[2]
        if self._begun and (message.startswith(_MADE) or _LOST in message):
            self._results.append(message)
            if len(self._results) >= self._begun:
                self._has_all.set()
