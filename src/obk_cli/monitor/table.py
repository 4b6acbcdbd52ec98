"""Format a running stack as lines for a terminal, or as an object for a program.

The lines of a `StackView` fit a given width: the least important columns are omitted first, so that
nothing wraps. The live table and `obk monitor --once` show the same lines.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import timedelta
from io import StringIO
from typing import Any, Final, Generic, TypeVar

from rich.cells import cell_len, set_cell_size

from obelisk_spec.suggestions import with_number
from obk_cli.launch.event_lines import short_name
from obk_cli.monitor.model import NodeView, StackView, TopicView
from obk_cli.runs.lifecycle import ACTIVE
from obk_cli.terminal import plain

__all__ = [
    "TableLine",
    "age_line",
    "head_line",
    "log_lines",
    "monitor_data",
    "monitor_text",
    "node_lines",
    "topic_lines",
]

T = TypeVar("T")

ONCE_LINES: Final = 8
"""Number of log lines that `--once` shows."""
_GAP: Final = "  "
LONGEST_WHOLE: Final = 30
"""Longer names are shortened before a column is omitted [cells]."""
_NARROWEST: Final = 12
"""Minimum width of the column of names [cells]."""
_WRONG: Final = "bold red"
_TITLE: Final = "bold dim"
_NOTHING: Final = "-"
_ROS_PREFIX: Final = re.compile(r"(?<=\]) \[\d+\.\d+\] \[[^\]]*\]:(?= )")
"""Time and logger, which are redundant because the node's name precedes them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TableLine:
    """One line, and the name of its style in rich."""

    text: str
    style: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Column(Generic[T]):
    """A column after the names; its width is constant, so that nothing jumps."""

    title: str
    width: int
    rank: int
    """The column with the highest rank is omitted first."""
    cell: Callable[[T], str]
    is_text: bool = False

    def aligned(self, text: str) -> str:
        """The text, aligned to the column's width."""
        cut = _fitted(text, self.width)
        return cut.ljust(self.width) if self.is_text else cut.rjust(self.width)


def head_line(view: StackView, width: int) -> TableLine:
    """The stack's name, state and problems."""
    off = sum(topic.is_off for topic in view.topics)
    rtf = view.realtime_factor
    is_slow = any(node.is_slow_simulation for node in view.nodes)
    parts = [
        _fitted(view.name, max(_NARROWEST, width // 3)) or "launched elsewhere",
        _standing(view),
        f"up {timedelta(seconds=int(view.uptime_s))}" if view.uptime_s else "",
        f"{with_number(off, 'topic')} off" if off else "",
        "simulation too slow" if is_slow else "",
        "" if rtf is None else f"real time x{rtf:.2f}",
        f"monitor {view.cost_percent:.1f} % CPU",
        f"domain {view.domain}",
    ]
    is_wrong = bool(off or is_slow or view.has_ended or (view.run and not view.state))
    text = ""
    for part in filter(None, parts):
        longer = f"{text}{_GAP}{part}" if text else part
        text = longer if cell_len(longer) <= width or not text else text
    return TableLine(text=_fitted(text, width), style=_WRONG if is_wrong else "bold green")


def node_lines(view: StackView, width: int) -> tuple[TableLine, ...]:
    """The column headings, then a line for each node."""
    rows = [(short_name(node.node), node, _node_style(node)) for node in view.nodes]
    return _table("node", rows, _NODE_COLUMNS, width)


def topic_lines(view: StackView, width: int) -> tuple[TableLine, ...]:
    """The column headings, then a line for each topic; `!` marks topics whose rate is off."""
    space = _common_space([topic.topic for topic in view.topics])
    rows = [
        (
            f"{'!' if topic.is_off else ' '} {topic.topic.removeprefix(space)}",
            topic,
            _WRONG if topic.is_off else "",
        )
        for topic in view.topics
    ]
    return _table(f"  {space or 'topic'}", rows, _TOPIC_COLUMNS, width)


def age_line(view: StackView, width: int) -> TableLine | None:
    """The age of data along its longest path; None if no node forwards stamps."""
    carried = [topic for topic in view.topics if topic.age and topic.age.is_carried]
    if not carried:
        return None
    topics = {topic.topic: topic for topic in view.topics}
    way = [carried[-1]]
    # In a loop, stamps lead back to topics already on the path.
    while up := next(
        (
            topics[name]
            for name in way[0].made_from
            if name in topics and topics[name].age and topics[name] not in way
        ),
        None,
    ):
        way.insert(0, up)
    steps = (
        f"{topic.topic.rpartition('/')[2]} {_ms(topic.age.p50_s)}" for topic in way if topic.age
    )
    return TableLine(text=_fitted(f"  age along the path [ms]: {' > '.join(steps)}", width))


def log_lines(view: StackView, width: int, part: str = "") -> tuple[TableLine, ...]:
    """The last lines of the log that contain this text, ignoring case."""
    shown = (_ROS_PREFIX.sub("", plain(line)).replace("\t", " ") for line in view.lines)
    return tuple(
        TableLine(text=_fitted(line, width), style=_log_style(line))
        for line in shown
        if part.lower() in line.lower()
    )


def monitor_text(view: StackView, width: int, *, colour: bool) -> str:
    """The whole view as text.

    Args:
        view: the stack.
        width: width of the terminal [cells].
        colour: whether the terminal supports colors.
    """
    age = age_line(view, width)
    blocks: list[Sequence[TableLine]] = [
        [head_line(view, width)],
        node_lines(view, width),
        [*topic_lines(view, width), *([age] if age else [])],
        log_lines(view, width)[-ONCE_LINES:],
    ]
    lines = [line for block in blocks if block for line in (*block, TableLine(text=""))]
    if not colour:
        return "\n".join(line.text for line in lines).rstrip()
    return _coloured(lines).rstrip()


def monitor_data(view: StackView) -> dict[str, Any]:
    """The whole view as data: the fields of `StackView`, and whether each topic's rate is off."""
    topics = [{**asdict(topic), "is_off": topic.is_off} for topic in view.topics]
    return {**asdict(view), "topics": topics}


def _coloured(lines: Iterable[TableLine]) -> str:
    from rich.console import Console  # slow to import
    from rich.text import Text

    console = Console(file=StringIO(), width=10_000, force_terminal=True, color_system="standard")
    with console.capture() as capture:
        for line in lines:
            console.print(Text(line.text, line.style))
    return capture.get()


def _standing(view: StackView) -> str:
    if view.has_ended:
        return f"has stopped: {plain(view.cause)}" if view.cause else "has stopped"
    if not view.run:
        return with_number(len(view.nodes), "node")
    return view.state or view.phase or "launcher does not answer"


def _node_style(node: NodeView) -> str:
    if node.hangs or node.state == "errorprocessing" or node.is_slow_simulation:
        return _WRONG
    return "" if node.state in (ACTIVE, "") else "cyan"


def _node_state(node: NodeView) -> str:
    return "hangs" if node.hangs else node.state or _NOTHING


def _pid(node: NodeView) -> str:
    shared = "+" if node.shares_process else ""
    return _NOTHING if node.pid is None else f"{node.pid}{shared}"


def _rates(node: NodeView) -> str:
    return ", ".join(plain(str(rate)) for rate in node.rates if rate.standing != "kept")


_NODE_COLUMNS: Final[tuple[_Column[NodeView], ...]] = (
    _Column(title="state", width=12, rank=0, cell=_node_state, is_text=True),
    _Column(title="pid", width=8, rank=3, cell=_pid),
    _Column(
        title="CPU %",
        width=6,
        rank=1,
        cell=lambda node: f"{node.load.cpu_percent:.1f}" if node.load else _NOTHING,
    ),
    _Column(
        title="RSS MB",
        width=6,
        rank=2,
        cell=lambda node: f"{node.load.memory_bytes / 1e6:.0f}" if node.load else _NOTHING,
    ),
    _Column(
        title="restarts",
        width=8,
        rank=4,
        cell=lambda node: str(node.restarts) if node.restarts else _NOTHING,
    ),
    _Column(
        title="up",
        width=9,
        rank=5,
        cell=lambda node: (
            str(timedelta(seconds=int(node.load.uptime_s))).replace(" days, ", "d ")
            if node.load
            else _NOTHING
        ),
    ),
    _Column(title="missed rates", width=60, rank=6, cell=_rates, is_text=True),
)
_TOPIC_COLUMNS: Final[tuple[_Column[TopicView], ...]] = (
    _Column(
        title="type",
        width=38,
        rank=9,
        cell=lambda topic: (topic.msg_type or _NOTHING).replace("/msg/", "/"),
        is_text=True,
    ),
    _Column(
        title="pub/sub",
        width=7,
        rank=4,
        cell=lambda topic: f"{topic.publishers}/{topic.subscriptions}",
    ),
    _Column(title="expected", width=8, rank=1, cell=lambda topic: _number(topic.expected_hz)),
    _Column(
        title="Hz",
        width=6,
        rank=0,
        cell=lambda topic: _number((topic.rate.rate_hz or 0.0) if topic.rate else None),
    ),
    _Column(
        title="jitter ms",
        width=9,
        rank=2,
        cell=lambda topic: _ms(topic.rate.jitter_s if topic.rate else None),
    ),
    _Column(
        title="kB/s",
        width=7,
        rank=6,
        cell=lambda topic: _number(
            topic.rate.bytes_per_s / 1e3
            if topic.rate and topic.rate.bytes_per_s is not None
            else None
        ),
    ),
    _Column(
        title="last ms",
        width=7,
        rank=5,
        cell=lambda topic: _ms(topic.rate.age_s if topic.rate else None, 0),
    ),
    _Column(
        title="age ms",
        width=8,
        rank=3,
        cell=lambda topic: _ms(topic.age.p50_s if topic.age else None),
    ),
    _Column(
        title="age p99",
        width=8,
        rank=7,
        cell=lambda topic: _ms(topic.age.p99_s if topic.age else None),
    ),
)


def _table(
    title: str, rows: Sequence[tuple[str, T, str]], columns: Sequence[_Column[T]], width: int
) -> tuple[TableLine, ...]:
    """The column headings and a line for each row of name, value and style."""
    longest = max([len(title), *(len(name) for name, _, _ in rows)])
    kept = list(columns)
    while kept and _needed(kept) + min(longest, LONGEST_WHOLE) > width:
        kept.remove(max(kept, key=lambda column: column.rank))
    names = max(_NARROWEST, min(longest, width - _needed(kept)))
    head = (_fitted(title, names).ljust(names), *(c.aligned(c.title) for c in kept))
    lines = [TableLine(text=_fitted(_GAP.join(head).rstrip(), width), style=_TITLE)]
    for name, value, style in rows:
        cells = (
            _fitted(name, names).ljust(names),
            *(column.aligned(column.cell(value)) for column in kept),
        )
        lines.append(TableLine(text=_fitted(_GAP.join(cells).rstrip(), width), style=style))
    return tuple(lines)


def _needed(columns: Iterable[_Column[Any]]) -> int:
    return sum(len(_GAP) + column.width for column in columns)


def _common_space(topics: Sequence[str]) -> str:
    """The common namespace of all topics, with a trailing slash; empty if there is none."""
    spaces = [topic.rpartition("/")[0].split("/") for topic in topics]
    common = list(_same(spaces)) if spaces else []
    return "/".join((*common, "")) if len(common) > 1 else ""


def _same(spaces: Sequence[Sequence[str]]) -> Iterator[str]:
    for parts in zip(*spaces, strict=False):
        if len(set(parts)) > 1:
            return
        yield parts[0]


def _log_style(line: str) -> str:
    if "[ERROR]" in line or "[FATAL]" in line or line.startswith("failed: "):
        return "red"
    return "yellow" if "[WARN]" in line else ""


def _number(value: float | None) -> str:
    if value is None:
        return _NOTHING
    return f"{value:.0f}" if value >= 1000 else f"{value:.4g}"


def _ms(seconds: float | None, digits: int = 2) -> str:
    return _NOTHING if seconds is None else f"{seconds * 1e3:.{digits}f}"


def _fitted(text: str, width: int) -> str:
    """The text without control characters, shortened to the width."""
    shown = plain(text)
    if cell_len(shown) <= width:
        return shown
    return set_cell_size(shown, max(0, width - 1)) + "…"
