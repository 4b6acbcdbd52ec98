"""A run for a person: what happens, one line an event, and the nodes' output behind their names."""

from collections.abc import Iterable

from obk_cli.launch.events import (
    Ended,
    Failed,
    Phase,
    ProcessEnded,
    ProcessStarted,
    StateSeen,
    Told,
    TransitionEnded,
)
from obk_cli.report.escapes import only_colour, plain

__all__ = ["LaunchReport"]

_NODE_COLOURS = ("36", "35", "34", "33", "32", "96", "95", "94")
_MARKS = {"reached": ("ok", "32"), "refused": ("FAILED", "31"), "timed out": ("TIMED OUT", "31")}


class LaunchReport:
    """Turns events and output into lines; may be called from several threads."""

    def __init__(self, nodes: Iterable[str], *, colour: bool, quiet: bool) -> None:
        """Make a report.

        Args:
            nodes: full names, for colours and column width.
            colour: whether to use escape codes.
            quiet: leave the nodes' output out.
        """
        self._short = {node: node.strip("/").removeprefix("obelisk_") for node in nodes}
        self._width = max(map(len, self._short.values()), default=0)
        self._colours = dict(zip(self._short, _NODE_COLOURS * len(self._short), strict=False))
        self._colour = colour
        self._quiet = quiet

    def line(self, node: str, text: str) -> Iterable[str]:
        """A line of a node's output."""
        if not self._quiet:
            name = self._paint(self._colours[node], f"{self._short[node]:<{self._width}} |")
            yield f"{name} {only_colour(text) if self._colour else plain(text)}"

    def event(self, event: Told) -> Iterable[str]:
        """What happened."""
        match event:
            case Phase():
                detail = f" ({event.detail})" if event.detail else ""
                yield self._paint("1", f"[{event.seconds:6.2f} s] {event.name}{detail}")
            case ProcessStarted():
                yield f"  {self._short[event.node]}: process {event.pid}"
            case TransitionEnded():
                mark, colour = _MARKS.get(event.result, (event.result, "31"))
                took = f"{event.seconds * 1e3:.0f} ms"
                yield (
                    f"  {self._short[event.node]}: {event.transition} "
                    f"{self._paint(colour, mark)} ({took})"
                )
                yield from self._fault(event.fault)
            case StateSeen():
                yield f"  {self._short[event.node]}: {event.state} (not asked for here)"
            case Failed():
                yield self._paint("31", f"  {self._short[event.node]}: FAILED")
                yield from self._fault(event.fault)
            case ProcessEnded():
                yield self._paint("31", f"  {self._short[event.node]}: {plain(event.how)}")
            case Ended() if event.cause:
                more = f" (and {event.consequences} more after it)" if event.consequences else ""
                yield self._paint("31", f"failed: {plain(event.cause)}{more}")
            case Ended():
                yield self._paint("32", "ended in order")

    def _fault(self, fault: str) -> Iterable[str]:
        """A node's own words; the traceback only where the node's output does not show it."""
        lines = fault.splitlines()
        shown = lines if self._quiet else _without_traceback(lines)
        return (f"    {plain(line)}" for line in shown)

    def _paint(self, code: str, text: str) -> str:
        return f"\x1b[{code}m{text}\x1b[0m" if self._colour else text


def _without_traceback(lines: list[str]) -> list[str]:
    start = next((n for n, line in enumerate(lines) if line.startswith("Traceback ")), None)
    return lines[:start]
