"""The status of a running stack as a few lines for the bottom of a terminal.

Takes a status and the terminal's size, gives lines that fit and take at most a third of it.
Imports rich, so it is itself to be imported only where there is a terminal.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from datetime import timedelta
from io import StringIO
from typing import Final

from rich.columns import Columns
from rich.console import Console, RenderableType
from rich.rule import Rule
from rich.text import Text

from obelisk_spec.suggestions import with_number
from obk_cli.report.launch import STEADY, short_name
from obk_cli.runs.lifecycle import ACTIVE, FINALIZED, INACTIVE, RESTING
from obk_cli.runs.protocol import NodeStatus, StackStatus

__all__ = ["status_lines"]

_RESTARTING: Final = "restarting"
_STYLES: Final = {ACTIVE: "green", INACTIVE: "cyan", "running": "green", _RESTARTING: "yellow"}
_GOING_DOWN: Final = ("stopping", "stopped")
_BAR_CELLS: Final = 20
_GAP: Final = 3
"""Between two nodes [cells]."""


def status_lines(status: StackStatus, width: int, height: int, *, colour: bool) -> list[str]:
    """The status for a terminal of this many columns and rows.

    As many rows as the nodes need, at most a third; where they need more, they are summed up.
    """
    # One column stays free: what fills the last one is wrapped by the smallest resize.
    paper = _Paper(max(1, width - 1), colour)
    room = max(1, height // 3)
    head = paper.lines(_head(status))[:1]
    if room < 3:
        return head
    rule = paper.lines(Rule(characters="─", style="dim"))
    return [*rule, *head, *_node_rows(status, paper, room - 2)]


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
    """The stack's name, where it stands, since when, and what is out of order."""
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
    """Steps done and to do on the way up, and the present one in words; None: not on it."""
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
    """Each node if there is room, else its tier, else a sum of all."""
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
        told = f" {rate.name} {rate.measured_hz:.4g}/{rate.wanted_hz:.4g} Hz"
        entry.append(told, "bold red" if rate.standing == "broken" else "yellow")
    return entry


def _summed(name: str, nodes: Iterable[NodeStatus], phase: str) -> Text:
    """`control  18 active  1 hangs: control_7`; names only where something is wrong."""
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
