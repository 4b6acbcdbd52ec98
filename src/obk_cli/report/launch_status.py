"""A run for a person at a terminal: lines, and the stack's status kept up for the area below them.

`opening_status` makes the status before anything runs, `with_event` folds in what happened.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Final

from msgspec import structs

from obelisk_spec.runtime_protocol import Rate
from obk_cli.launch.events import (
    AnswersAgain,
    Failed,
    Hung,
    OutputEvent,
    Phase,
    ProcessEnded,
    ProcessStarted,
    RateBroken,
    RateKept,
    RateMoved,
    Restarting,
    StackStateChanged,
    StateSeen,
    TransitionEnded,
)
from obk_cli.launch.process_groups import Unit
from obk_cli.plan.plan import Plan
from obk_cli.report.launch import LaunchReport
from obk_cli.runs.lifecycle import ACTIVE, FINALIZED, TRANSITIONS, UNCONFIGURED
from obk_cli.runs.protocol import NodeStatus, StackStatus

__all__ = ["LiveReport", "opening_status", "with_event"]

UNKNOWN: Final = "unknown"


def opening_status(plan: Plan, units: Iterable[Unit], *, leads: bool = True) -> StackStatus:
    """A stack before its start.

    Args:
        plan: the whole stack.
        units: the processes that will run here.
        leads: whether the nodes of other devices are taken through transitions from here too.
    """
    here: Mapping[str, str] = {node: unit.name for unit in units for node in unit.node_names}
    nodes = tuple(
        NodeStatus(
            node=process.full_name,
            section=process.section,
            device=process.device,
            state=UNKNOWN if process.has_lifecycle else "",
            process=here.get(process.full_name, process.full_name),
            pid=None,
            restarts=0,
            hangs=False,
        )
        for tier in plan.tiers
        for process in tier
        if leads or process.full_name in here
    )
    return StackStatus(name=plan.name, state="", phase="starting", seconds=0.0, nodes=nodes)


def with_event(status: StackStatus, event: OutputEvent) -> StackStatus:
    """The status after an event."""
    match event:
        case Phase(name="rolling back"):
            return status  # an episode, after which the stack is where it was
        case Phase():
            status = structs.replace(status, phase=event.name, seconds=event.seconds)
        case StackStateChanged():
            return structs.replace(status, state=event.state)
        case _:
            pass
    return structs.replace(status, nodes=tuple(_with_rates(node, event) for node in status.nodes))


def _with_rates(node: NodeStatus, event: OutputEvent) -> NodeStatus:
    """A node after an event; it has the rates that are not kept, while it is active."""
    after = _node_after(node, event)
    return replace(after, rates=()) if after.rates and after.state != ACTIVE else after


def _with_rate(rates: tuple[Rate, ...], rate: Rate) -> tuple[Rate, ...]:
    others = tuple(other for other in rates if other.name != rate.name)
    return others if rate.standing == "kept" else (*others, rate)


def _node_after(node: NodeStatus, event: OutputEvent) -> NodeStatus:
    match event:
        case Phase(name="ready") if node.state == UNKNOWN:
            return replace(node, state=UNCONFIGURED)
        case ProcessStarted(process=node.process):
            return replace(node, pid=event.pid)
        case ProcessEnded(process=node.process):
            ended = FINALIZED if node.state else ""
            return replace(node, pid=None, state=ended, hangs=False)
        case StateSeen(node=node.node):
            return replace(node, state=event.state)
        case Failed(node=node.node):
            return replace(node, state="errorprocessing")
        case TransitionEnded(node=node.node):
            return replace(node, state=_state_after(event, node.state))
        case Hung(node=node.node) | AnswersAgain(node=node.node):
            return replace(node, hangs=isinstance(event, Hung))
        case RateBroken(node=node.node) | RateKept(node=node.node) | RateMoved(node=node.node):
            return replace(node, rates=_with_rate(node.rates, event.rate))
        case Restarting() if node.node in event.nodes:
            unknown = UNKNOWN if node.state else ""
            return replace(node, state=unknown, restarts=node.restarts + 1, hangs=False)
        case _:
            return node


def _state_after(event: TransitionEnded, before: str) -> str:
    transition = TRANSITIONS[event.transition]
    match event.result:
        case "reached" | "there already":
            return transition.goal
        case "taken back" if transition.undo:
            return TRANSITIONS[transition.undo].goal
        case _:
            return before


class LiveReport:
    """A `LaunchReport` that also knows the status; may be called from several threads."""

    def __init__(
        self,
        report: LaunchReport,
        opening: StackStatus,
        *,
        clock: Callable[[], float],
        colour: bool,
    ) -> None:
        """Make a report.

        Args:
            report: words the lines.
            opening: the status before the start.
            clock: monotonic time [s].
            colour: whether the area is coloured.
        """
        self._report = report
        self._status = opening
        self._clock = clock
        self._begin_s = clock()
        self._colour = colour
        self._drawn: tuple[object, list[str]] = (None, [])
        """What the area was drawn of last, and its lines."""
        self.line = report.line
        self.note = report.note

    def event(self, event: OutputEvent) -> Iterable[str]:
        """What happened."""
        self._status = with_event(self._status, event)
        return self._report.event(event)

    def draw(self, width: int, height: int) -> list[str]:
        """The status area for a terminal of this many columns and rows; for one thread only."""
        from obk_cli.report.status_area import status_lines  # rich is slow to import

        seconds = int(self._clock() - self._begin_s)
        wanted = (structs.replace(self._status, seconds=seconds), width, height)
        if self._drawn[0] != wanted:
            self._drawn = (wanted, status_lines(*wanted, colour=self._colour))
        return self._drawn[1]
