"""The films of a run: reports at its end what the simulated robots recorded."""

from collections.abc import Callable
from typing import Final

from obelisk_spec.suggestions import list_names
from obk_cli.launch.events import Ended, OutputEvent, Phase, VideoReported
from obk_cli.launch.process_groups import Share
from obk_cli.launch.sim_options import simulated_robots
from obk_cli.plan.plan import Plan

__all__ = ["VideoReports"]

_UNKNOWN: Final = "warning: the robot did not report how its film ended"


class VideoReports:
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

    def on_event(self, event: OutputEvent) -> None:
        """Collect what robots report, and show it when the run has ended."""
        match event:
            case VideoReported(video=video) if video.state == "recording":
                self._has_begun = True
            case VideoReported(video=video):
                self._results.append(str(video))
            case Phase(name="active") if self._expected and not self._has_begun:
                names = list_names(node.full_name for node in self._expected)
                self._note(f"warning: no film has begun, which `render` asks for of {names}")
            case Ended() if self._has_begun:
                for text in self._results or [_UNKNOWN]:
                    self._note(text)
