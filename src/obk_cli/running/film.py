"""The films of a run: reports at its end what the simulated robots recorded."""

from collections.abc import Callable
from typing import Final

from obelisk_spec.suggestions import list_names
from obk_cli.launch.devices import Share
from obk_cli.launch.events import Ended, Phase, Told, VideoReported
from obk_cli.plan import Plan
from obk_cli.running.simulated import simulated_robots

__all__ = ["Films"]

_UNKNOWN: Final = "warning: the robot did not report how its film ended"


class Films:
    """The films that the robots of a run have reported; `on_event` subscribes to its events."""

    def __init__(self, plan: Plan, share: Share, note: Callable[[str], None]) -> None:
        """Expect a film of each simulated robot that has the parameter `render`.

        Args:
            plan: a whole stack.
            share: what of it runs here.
            note: shows a line to the user.
        """
        robots = simulated_robots(plan, share)
        self._expected = [node for node in robots if node.parameters.get("render")]
        self._note = note
        self._has_begun = False
        self._results: list[str] = []

    def on_event(self, event: Told) -> None:
        """Collect what robots report, and show it when the run has ended."""
        match event:
            case VideoReported(film=film) if film.state == "recording":
                self._has_begun = True
            case VideoReported(film=film):
                self._results.append(str(film))
            case Phase(name="active") if self._expected and not self._has_begun:
                names = list_names(node.full_name for node in self._expected)
                self._note(f"warning: no film has begun, which `render` asks for of {names}")
            case Ended() if self._has_begun:
                for text in self._results or [_UNKNOWN]:
                    self._note(text)
