"""How a run is shown: lines, lines with a status area below them on a terminal, or JSON."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from obk_cli.adapters.clock import monotonic_s, wall_s
from obk_cli.adapters.footer import takes_footer
from obk_cli.adapters.screen import Screen
from obk_cli.launch.units import Unit
from obk_cli.plan.plan import Plan
from obk_cli.report.launch import LaunchReport
from obk_cli.report.launch_json import JsonReport
from obk_cli.report.launch_status import LiveReport, opening_status
from obk_cli.running.output import Voice

__all__ = ["Surface", "open_surface"]


class Surface:
    """A screen, and the voice that speaks on it."""

    def __init__(
        self,
        screen: Screen,
        *,
        json: JsonReport | None,
        colour: bool,
        quiet: bool,
        takes_status: bool,
    ) -> None:
        """Speak JSON where that is given, else lines for a person."""
        self.screen = screen
        self._json = json
        self._colour = colour
        self._quiet = quiet
        self._takes_status = takes_status

    def voice(self, plan: Plan, units: Iterable[Unit], *, leads: bool) -> Voice:
        """The voice for a run; where the screen takes one, a status area begins."""
        if self._json is not None:
            return self._json
        names = (node.full_name for node in plan.processes)
        report = LaunchReport(names, colour=self._colour, quiet=self._quiet)
        if not self._takes_status:
            return report
        opening = opening_status(plan, units, leads=leads)
        live = LiveReport(report, opening, clock=monotonic_s, colour=self._colour)
        self.screen.set_footer(live.draw)
        return live


@contextmanager
def open_surface(
    fd: int, *, as_json: bool, colour: bool, quiet: bool, terminal: str
) -> Iterator[Surface]:
    """What a run is shown on.

    Args:
        fd: where it is written.
        as_json: one JSON object a line.
        colour: whether lines may be coloured.
        quiet: leave the nodes' output out.
        terminal: the variable TERM.
    """
    json = JsonReport(wall_s, quiet=quiet) if as_json else None
    with Screen(fd, left_out=json.left_out) if json else Screen(fd) as screen:
        takes_status = not as_json and takes_footer(fd, terminal)
        yield Surface(screen, json=json, colour=colour, quiet=quiet, takes_status=takes_status)
