"""The film of a run, as its launch tells of it: whether it has begun, and what there is at the end.

The simulated robot makes it and says so in its log; here those lines are picked out, so that the
end of the run tells of the film, however much else was logged.
"""

import threading
from collections.abc import Callable
from typing import Final

from obelisk_spec.suggestions import list_names
from obk_cli.launch.devices import Share
from obk_cli.launch.events import Ended, Phase, Told
from obk_cli.plan.plan import Plan
from obk_cli.running.output import Output
from obk_cli.running.simulated import simulated_robots

__all__ = ["Film"]

_BEGUN: Final = "a film goes to "
_MADE: Final = "film: "
_LOST: Final = "there is no film"
_LOGGER: Final = "]: "
"""Between the logger's name and what it says."""
_WAIT_S: Final = 1.0
"""For the last lines of a robot that has ended [s]."""


class Film:
    """Stands between a run's processes and those who hear of them."""

    def __init__(self, plan: Plan, share: Share, output: Output) -> None:
        """Expect a film of each simulated robot that has the parameter `render`.

        Args:
            plan: a whole stack.
            share: what of it runs here.
            output: takes what is told of films.
        """
        robots = simulated_robots(plan, share)
        self._wanted = [node for node in robots if node.parameters.get("render")]
        self._output = output
        # Each robot's lines come on a thread of their own.
        self._lock = threading.Lock()
        self._begun = 0
        self._told: list[str] = []
        self._all_told = threading.Event()

    def lines(self, others: Callable[[str, str], None]) -> Callable[[str, str], None]:
        """Listen to what the processes write, which others get all the same."""
        if not self._wanted:
            return others

        def line(unit: str, text: str) -> None:
            others(unit, text)
            with self._lock:
                self._hear(text)

        return line

    def telling(self, others: Callable[[Told], None]) -> Callable[[Told], None]:
        """Tell of the films when the run has ended, before others are told so."""
        if not self._wanted:
            return others

        def tell(told: Told) -> None:
            if isinstance(told, Ended):
                self._end()
            others(told)
            if isinstance(told, Phase) and told.name == "active":
                self._look()

        return tell

    def _hear(self, text: str) -> None:
        if _BEGUN in text:
            self._begun += 1
            self._all_told.clear()
        said = text.rpartition(_LOGGER)[2]
        if self._begun and (said.startswith(_MADE) or _LOST in said):
            self._told.append(said)
            if len(self._told) >= self._begun:
                self._all_told.set()

    def _look(self) -> None:
        if self._begun < len(self._wanted):
            names = list_names(node.full_name for node in self._wanted)
            self._output.note(f"warning: no film has begun, which `render` asks for of {names}")

    def _end(self) -> None:
        if self._begun:
            self._all_told.wait(_WAIT_S)
            for text in self._told or ["warning: what has become of the film was not told"]:
                self._output.note(text)
