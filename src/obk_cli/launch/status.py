"""The status area of a launch: the state of each node, drawn at the bottom of the terminal."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import timedelta
from io import StringIO
from typing import Final

from msgspec import structs
from rich.columns import Columns
from rich.console import Console, RenderableType
from rich.rule import Rule
from rich.text import Text

from obelisk_spec.runtime_protocol import Rate, hz
from obelisk_spec.suggestions import with_number
from obk_cli.launch.event_lines import STEADY, LaunchReport, short_name
from obk_cli.launch.events import (
    AnswersAgain,
    Failed,
    Hung,
    OutputEvent,
    PageReported,
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
from obk_cli.launch.transitions import UNKNOWN
from obk_cli.plan.plan import Plan
from obk_cli.runs.lifecycle import ACTIVE, FINALIZED, INACTIVE, RESTING, TRANSITIONS, UNCONFIGURED
from obk_cli.runs.protocol import NodeStatus, StackStatus

__all__ = ["LiveReport", "opening_status", "status_lines", "with_event"]


def opening_status(plan: Plan, units: Iterable[Unit], *, leads: bool = True) -> StackStatus:
    """The status of a stack before it starts.

    Args:
        plan: the whole stack.
        units: the processes that will run here.
        leads: whether this launch also runs the transitions of other devices' nodes.
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
            return status  # an episode, after which the phase is the same as before
        case Phase():
            status = structs.replace(status, phase=event.name, seconds=event.seconds)
        case StackStateChanged():
            return structs.replace(status, state=event.state)
        case _:
            pass
    return structs.replace(status, nodes=tuple(_with_rates(node, event) for node in status.nodes))


def _with_rates(node: NodeStatus, event: OutputEvent) -> NodeStatus:
    """A node's status after an event; while active, it includes rates that are not as expected."""
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
            return replace(node, pid=None, state=ended, hangs=False, page="")
        case StateSeen(node=node.node):
            return replace(node, state=event.state)
        case Failed(node=node.node):
            return replace(node, state="errorprocessing")
        case TransitionEnded(node=node.node):
            return replace(node, state=_state_after(event, node.state))
        case PageReported(node=node.node):
            return replace(node, page=event.url)
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
        case "reached" | "already there":
            return transition.goal
        case "rolled back" if transition.undo:
            return TRANSITIONS[transition.undo].goal
        case _:
            return before


class LiveReport:
    """A `LaunchReport` that also tracks the status; may be called from several threads."""

    def __init__(
        self,
        report: LaunchReport,
        opening: StackStatus,
        *,
        clock: Callable[[], float],
        colour: bool,
    ) -> None:
        """Create a report.

        Args:
            report: formats the lines.
            opening: the status before the start.
            clock: monotonic time [s].
            colour: whether the area is colored.
        """
        self._report = report
        self._status = opening
        self._clock = clock
        self._begin_s = clock()
        self._colour = colour
        self._drawn: tuple[object, list[str]] = (None, [])
        """What the area was last drawn from, and its lines."""
        self.line = report.line
        self.note = report.note
        self.on_screen = report.on_screen
        self.due = report.due

    def event(self, event: OutputEvent) -> Iterable[str]:
        """Format an event."""
        self._status = with_event(self._status, event)
        return self._report.event(event)

    def draw(self, width: int, height: int) -> list[str]:
        """The status area for a terminal of this size; call it from one thread only."""
        seconds = int(self._clock() - self._begin_s)
        picture = (structs.replace(self._status, seconds=seconds), width, height)
        if self._drawn[0] != picture:
            self._drawn = (picture, status_lines(*picture, colour=self._colour))
        return self._drawn[1]


_RESTARTING: Final = "restarting"
_STYLES: Final = {ACTIVE: "green", INACTIVE: "cyan", "running": "green", _RESTARTING: "yellow"}
_GOING_DOWN: Final = ("stopping", "stopped")
_BAR_CELLS: Final = 20
_GAP: Final = 3
"""Gap between two nodes [cells]."""


def status_lines(status: StackStatus, width: int, height: int, *, colour: bool) -> list[str]:
    """The status for a terminal of this many columns and rows.

    It uses as many rows as the nodes need, at most a third of the terminal; then it summarizes
    them. The URLs of pages are always shown, and wrapped by the terminal rather than cut.
    """
    # One column stays free, because even a small resize wraps a full last column.
    paper = _Paper(max(1, width - 1), colour)
    room = max(1, height // 3)
    pages = [f"{short_name(node.node)}: {node.page}" for node in status.nodes if node.page]
    head = [*paper.lines(_head(status))[:1], *pages]
    if room < 3:
        return head
    rule = paper.lines(Rule(characters="─", style="dim"))
    return [*rule, *head, *_node_rows(status, paper, max(1, room - 1 - len(head)))]


class _Paper:
    """Renders for one width."""

    def __init__(self, width: int, colour: bool) -> None:
        self._width = width
        self._colour = colour

    def lines(self, what: RenderableType) -> list[str]:
        console = Console(
            file=StringIO(),
            width=self._width,
            color_system="standard" if self._colour else None,
            force_terminal=True,
            no_color=False,
            legacy_windows=False,
            highlight=False,
        )
        with console.capture() as capture:
            console.print(what, no_wrap=True, overflow="ellipsis")
        return [line.rstrip() for line in capture.get().splitlines()]


def _head(status: StackStatus) -> Text:
    """The stack's name, state, time since the launch, and problems."""
    state = (status.phase in ("ready", *STEADY) and status.state) or status.phase
    facts = [Text(status.name, "bold"), Text(state, _STYLES.get(state, "bold"))]
    if progress := _progress(status):
        done, total, step = progress
        filled = _BAR_CELLS * done // max(1, total)
        rest = "─" * (_BAR_CELLS - filled)
        facts += [Text.assemble(("━" * filled, "green"), (rest, "dim")), Text(step)]
    facts += [Text(str(timedelta(seconds=int(status.seconds)))), *_troubles(status.nodes)]
    return Text("  ").join(facts)


def _progress(status: StackStatus) -> tuple[int, int, str] | None:
    """During bring-up: steps done, steps in total, the current one as text; otherwise None."""
    count = len(status.nodes)
    started = sum(node.pid is not None or node.state in RESTING for node in status.nodes)
    if status.phase == "starting":
        return started, 3 * count, f"{started} of {count} started"
    if status.phase != "ready":
        return None
    living = [node for node in status.nodes if node.state]
    active = sum(node.state == ACTIVE for node in living)
    configured = active + sum(node.state == INACTIVE for node in living)
    total = 3 * len(living)
    if configured < len(living):
        return len(living) + configured, total, f"{configured} of {len(living)} configured"
    return len(living) + configured + active, total, f"{active} of {len(living)} active"


def _troubles(nodes: Sequence[NodeStatus]) -> Iterator[Text]:
    yield Text(with_number(len(nodes), "node"))
    if restarts := sum(node.restarts for node in nodes):
        yield Text(with_number(restarts, "restart"), "yellow")
    if hanging := sum(node.hangs for node in nodes):
        yield Text(f"{hanging} hanging", "bold red")
    if rates := sum(len(node.rates) for node in nodes):
        yield Text(f"{with_number(rates, 'rate')} off", "yellow")


def _node_rows(status: StackStatus, paper: _Paper, room: int) -> list[str]:
    """Each node if there is room, otherwise its tier, otherwise a summary of all."""
    entries = [_entry(node, status.phase) for node in status.nodes]
    rows = paper.lines(Columns(entries, padding=(0, _GAP), equal=True))
    if len(rows) <= room:
        return rows
    sections = dict.fromkeys(node.section for node in status.nodes)
    tiers = [(name, [n for n in status.nodes if n.section == name]) for name in sections]
    groups = tiers if len(tiers) <= room else [("all", list(status.nodes))]
    width = max(len(name) for name, _ in groups)
    return [
        line
        for name, nodes in groups
        for line in paper.lines(_summed(f"{name:<{width}}", nodes, status.phase))
    ]


def _entry(node: NodeStatus, phase: str) -> Text:
    word = _word(node)
    entry = Text.assemble(
        f"{short_name(node.node)} ", (word, _style(word, phase)), no_wrap=True, overflow="ellipsis"
    )
    if node.restarts and word != _RESTARTING:
        entry.append(f" (restarted {node.restarts}x)", "yellow")
    for rate in node.rates:
        text = f" {rate.name} {hz(rate.measured_hz)}/{hz(rate.expected_hz)} Hz"
        entry.append(text, "bold red" if rate.standing == "broken" else "yellow")
    return entry


def _summed(name: str, nodes: Iterable[NodeStatus], phase: str) -> Text:
    """`control  18 active  1 hangs: control_7`; names only nodes with problems."""
    line = Text(name)
    for word, count in Counter(map(_word, nodes)).most_common():
        style = _style(word, phase)
        line.append(" ").append(f" {count} {word}", style)
        if style == "bold red":
            line.append(": " + ", ".join(short_name(n.node) for n in nodes if _word(n) == word))
    return line


def _word(node: NodeStatus) -> str:
    """A node's state as one word."""
    if node.hangs:
        return "hangs"
    if node.pid is None and node.state == FINALIZED:
        return "ended"
    if node.state == "unknown":
        return _RESTARTING if node.restarts else "waiting" if node.pid is None else "started"
    return node.state or ("waiting" if node.pid is None else "running")


def _style(word: str, phase: str) -> str:
    if word in ("hangs", "errorprocessing") or (word == "ended" and phase not in _GOING_DOWN):
        return "bold red"
    return _STYLES.get(word, "dim")
