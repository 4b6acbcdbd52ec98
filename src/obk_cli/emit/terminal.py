"""The graph drawn with box characters, for a terminal.

Nodes are listed from top to bottom, each with the topics that it subscribes to and publishes. Each
topic that connects nodes is a rail on their right.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from obk_cli.emit.graph import Graph, GraphNode, GraphTopic
from obk_cli.terminal import columns_of, printable, shortened

__all__ = ["emit_terminal"]

_NARROWEST = 44
"""Minimum number of columns inside a node's box, however many rails there are."""
_RIGHT = 30
"""Minimum number of columns for the right part of a line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Row:
    """A line: the text in the box and, if a topic leaves or enters it, the topic."""

    left: str = ""
    right: str = ""
    frame: str = "side"
    """`side`, `top`, `bottom`, or `none` outside boxes."""
    topic: str = ""
    is_subscribed: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rail:
    """The position of a topic's rail: column, first row and last row."""

    place: int
    first: int
    last: int


def emit_terminal(graph: Graph, width: int = 80) -> str:
    """The drawing as text; wider than `width` only if the rails leave no room."""
    rows = [row for device in graph.devices for row in _device_rows(graph, device)]
    rails = _rails(rows)
    places = 1 + max((rail.place for rail in rails.values()), default=0)
    inside = max(_NARROWEST, width - 4 - 2 * places)
    lines = [graph.title, *(_line(i, row, inside, places, rails) for i, row in enumerate(rows))]
    return "".join(f"{line.rstrip()}\n" for line in lines)


def _device_rows(graph: Graph, device: str) -> Iterator[_Row]:
    yield _Row(frame="none")
    yield _Row(left=printable(device), frame="none")
    for node in graph.nodes:
        if node.device == device:
            yield from _node_rows(graph, node)


def _node_rows(graph: Graph, node: GraphNode) -> Iterator[_Row]:
    package, executable, *model = node.facts
    yield _Row(left=node.section, frame="top")
    yield _Row(left=node.title, right=package)
    yield _Row(left="".join(model), right=executable)
    for topic in graph.topics:
        if node.name in topic.subscribers:
            yield _topic_row(topic, "◀", is_subscribed=True)
    for topic in graph.topics:
        if node.name in topic.publishers:
            yield _topic_row(topic, "▶", is_subscribed=False)
            yield from (_Row(left=f"    {sensor}") for sensor in topic.sensors)
    yield _Row(frame="bottom")


def _topic_row(topic: GraphTopic, mark: str, *, is_subscribed: bool) -> _Row:
    return _Row(
        left=f"{mark} {topic.title}",
        right=topic.summary,
        topic=topic.name,
        is_subscribed=is_subscribed,
    )


def _rails(rows: Sequence[_Row]) -> Mapping[str, _Rail]:
    """A rail for each topic with more than one end; shorter ones are nearer to the boxes."""
    ends: dict[str, list[int]] = {}
    for i, row in enumerate(rows):
        if row.topic:
            ends.setdefault(row.topic, []).append(i)
    spans = [(at[-1] - at[0], at[0], at[-1], name) for name, at in ends.items() if len(at) > 1]
    rails: dict[str, _Rail] = {}
    for _, first, last, name in sorted(spans):
        taken = {r.place for r in rails.values() if r.first <= last and first <= r.last}
        place = next(i for i in range(len(spans)) if i not in taken)
        rails[name] = _Rail(place=place, first=first, last=last)
    return rails


def _line(i: int, row: _Row, inside: int, places: int, rails: Mapping[str, _Rail]) -> str:
    rail = rails.get(row.topic)
    passing = {r.place for r in rails.values() if r.first <= i <= r.last}
    cells = [" │" if place in passing else "  " for place in range(places)]
    if rail is not None:
        for place in range(rail.place):
            cells[place] = "─┼" if place in passing else "──"
        corners = {rail.first: "╮", rail.last: "╯"}
        cells[rail.place] = "─" + corners.get(i, "┤")
    elif row.topic:  # no node at the other end
        cells[0] = "○" + cells[0][1]
    return _box_part(row, inside) + "".join(cells)


def _box_part(row: _Row, inside: int) -> str:
    if row.frame == "none":
        return _filled(shortened(row.left, inside + 4), "", inside + 4)
    if row.frame == "top":
        name = f"─ {row.left} "
        return f"╭{name}{'─' * (inside + 2 - columns_of(name))}╮"
    if row.frame == "bottom":
        return f"╰{'─' * (inside + 2)}╯"
    edge = "│"
    if row.topic:
        edge = "◀" if row.is_subscribed else "├"
    return f"│ {_filled(row.left, row.right, inside)} {edge}"


def _filled(left: str, right: str, width: int) -> str:
    """The left text, padding, and the right text; the left one is shortened first."""
    right = shortened(right, max(_RIGHT, width - columns_of(left) - 2))
    room = width - columns_of(right) - (2 if right else 0)
    left = shortened(left, room)
    return left + " " * (width - columns_of(left) - columns_of(right)) + right
