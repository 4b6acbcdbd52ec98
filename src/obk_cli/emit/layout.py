"""Where everything of a picture goes: boxes in layers from left to right, lines between them.

A graph and the sizes of its boxes in, coordinates out. Each device is a band over the whole width;
what goes back to the left runs below everything. Draws nothing.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from obk_cli.emit.columns import TRACK, Columns, place_columns
from obk_cli.emit.graph import Graph, GraphNode, GraphTopic
from obk_cli.emit.layers import Chain, Layers, Return, Slot, layers_of
from obk_cli.emit.rows import band_borders, place_rows

__all__ = ["Band", "Box", "Layout", "Way", "lay_out"]

Point = tuple[float, float]
_PASSING_PX = 6.0
"""Height that a line takes where it passes a layer."""
_LANES_BELOW_PX = 16.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """A node or a topic with its place; x and y are the upper left corner [px]."""

    item: GraphNode | GraphTopic
    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Band:
    """A device, over the whole width [px]."""

    device: str
    y: float
    height: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """A line from a box to a box."""

    points: tuple[Point, ...]
    is_return: bool
    """Whether it goes in right angles; else every second piece, from the first on, is a bend."""
    section: str
    """Of the node that publishes."""
    has_arrow: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """A whole picture [px]."""

    width: float
    height: float
    boxes: tuple[Box, ...]
    bands: tuple[Band, ...]
    ways: tuple[Way, ...]


def lay_out(
    graph: Graph, size_of: Callable[[GraphNode | GraphTopic], tuple[float, float]]
) -> Layout:
    """Lay a graph out; `size_of` says how wide and high the box of a node or topic has to be."""
    layers = layers_of(graph)
    slots = [slot for layer in layers.layers for slot in layer]
    sizes = {slot: size_of(slot.item) if slot.item else (0.0, _PASSING_PX) for slot in slots}
    heights = {slot: height for slot, (_, height) in sizes.items()}
    borders = band_borders(layers.layers, heights, len(graph.devices))
    middles = place_rows(layers.layers, heights, borders)
    # The lower of two topics in a layer runs back inside of the other.
    returns = sorted(layers.returns, key=lambda r: (r.topic.layer, -middles[r.topic]))
    columns = place_columns(layers.layers, {s: width for s, (width, _) in sizes.items()}, returns)
    bottom = borders[-1][1] if borders else 0.0
    ways = _Ways(layers, returns, columns, middles, heights, bottom)
    return Layout(
        width=columns.width,
        height=ways.bottom,
        boxes=tuple(_box(slot, columns, middles, heights) for slot in slots if slot.item),
        bands=tuple(
            Band(device=device, y=top, height=bottom - top)
            for device, (top, bottom) in zip(graph.devices, borders, strict=True)
        ),
        ways=(*map(ways.forward, layers.chains), *map(ways.back, returns)),
    )


def _box(
    slot: Slot, columns: Columns, middles: Mapping[Slot, float], heights: Mapping[Slot, float]
) -> Box:
    assert slot.item is not None  # asked for boxes only
    left = columns.lefts[slot.layer]
    return Box(
        item=slot.item,
        x=left,
        y=middles[slot] - heights[slot] / 2,
        width=columns.rights[slot.layer] - left,
        height=heights[slot],
    )


class _Ways:
    """The lines, once all boxes have their places."""

    def __init__(
        self,
        layers: Layers,
        returns: list[Return],
        columns: Columns,
        middles: Mapping[Slot, float],
        heights: Mapping[Slot, float],
        bottom: float,
    ) -> None:
        self._columns = columns
        self._middles = middles
        self._heights = heights
        topics = list(dict.fromkeys(r.topic for r in returns))
        self._lanes = {
            topic: bottom + _LANES_BELOW_PX + i * TRACK for i, topic in enumerate(topics)
        }
        self.bottom = max(self._lanes.values(), default=bottom)
        self._ports = dict(self._port_places(layers, returns))

    def forward(self, chain: Chain) -> Way:
        """A line to the right, straight through the layers that it passes."""
        lefts, rights = self._columns.lefts, self._columns.rights
        start, *passed, end = chain.slots
        points = [(rights[start.layer], self._ports[start, chain.slots[1]])]
        for slot in passed:
            y = self._middles[slot]
            points += [(lefts[slot.layer], y), (rights[slot.layer], y)]
        points.append((lefts[end.layer], self._ports[end, chain.slots[-2]]))
        return Way(
            points=tuple(points),
            is_return=False,
            section=chain.section,
            has_arrow=isinstance(end.item, GraphNode),
        )

    def back(self, way: Return) -> Way:
        """Out to the right, down, below everything to the left, up, and into the node."""
        out = self._columns.exits[way.topic]
        up = self._columns.entries[way.topic, way.node.layer]
        lane = self._lanes[way.topic]
        start, end = self._middles[way.topic], self._ports[way.node, way.topic]
        return Way(
            points=(
                (self._columns.rights[way.topic.layer], start),
                (out, start),
                (out, lane),
                (up, lane),
                (up, end),
                (self._columns.lefts[way.node.layer], end),
            ),
            is_return=True,
            section=way.section,
            has_arrow=True,
        )

    def _port_places(
        self, layers: Layers, returns: list[Return]
    ) -> Iterator[tuple[tuple[Slot, Slot], float]]:
        """Where lines meet a box, by the box and what is at the other end of the piece."""
        for slot in (slot for layer in layers.layers for slot in layer):
            entering = [r.topic for r in returns if r.node is slot]
            arriving = sorted(slot.before, key=lambda other: self._middles[other])
            leaving = sorted(slot.after, key=lambda other: self._middles[other])
            # Of the ways back the outermost comes up furthest left and goes in highest.
            yield from self._spread(slot, [*arriving, *reversed(entering)])
            yield from self._spread(slot, leaving)

    def _spread(self, slot: Slot, others: list[Slot]) -> Iterator[tuple[tuple[Slot, Slot], float]]:
        """Side by side along a node's edge; a topic's lines all meet in the middle."""
        top = self._middles[slot] - self._heights[slot] / 2
        for i, other in enumerate(others):
            share = (i + 1) / (len(others) + 1) if isinstance(slot.item, GraphNode) else 0.5
            yield (slot, other), top + share * self._heights[slot]
