"""The graph in layers, left to right: nodes and topics take turns, long lines keep a slot.

What is said to a node further right goes through a slot in every layer between, so that no line has
to cross a box; what is said to a node further left is a return. Knows nothing of sizes.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

from obk_cli.emit.graph import Graph, GraphNode, GraphTopic
from obk_cli.emit.ranks import rank_nodes

__all__ = ["Chain", "Layers", "Return", "Slot", "layers_of"]

_SWEEPS = 6


@dataclass(slots=True, eq=False)
class Slot:
    """A place in a layer: of a node, of a topic, or (no item) of a line that passes."""

    item: GraphNode | GraphTopic | None
    layer: int
    band: int
    """Which device, by number."""
    before: list["Slot"] = field(default_factory=list)
    """In the layer to the left, joined by a line."""
    after: list["Slot"] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Chain:
    """A line to the right: from a box, through passing slots, to a box."""

    slots: tuple[Slot, ...]
    section: str
    """Of the node that publishes."""


@dataclass(frozen=True, slots=True)
class Return:
    """A line back: from a topic's box to a node's."""

    topic: Slot
    node: Slot
    section: str


@dataclass(frozen=True, slots=True)
class Layers:
    """The layers, each from top to bottom, and what joins them."""

    layers: tuple[tuple[Slot, ...], ...]
    chains: tuple[Chain, ...]
    returns: tuple[Return, ...]


def layers_of(graph: Graph) -> Layers:
    """Put a graph into layers."""
    return _Builder(graph).build()


class _Builder:
    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        ranks = rank_nodes(graph)
        bands = {device: i for i, device in enumerate(graph.devices)}
        self._sections = {node.name: node.section for node in graph.nodes}
        self._nodes = {
            node.name: Slot(node, 2 * ranks[node.name] + 1, bands[node.device])
            for node in graph.nodes
        }
        self._slots = list(self._nodes.values())
        self._chains: list[Chain] = []
        self._returns: list[Return] = []

    def build(self) -> Layers:
        for topic in self._graph.topics:
            self._add_topic(topic)
        used = sorted({slot.layer for slot in self._slots})
        for slot in self._slots:
            slot.layer = used.index(slot.layer)
        layers = [[s for s in self._slots if s.layer == layer] for layer in range(len(used))]
        _order(layers)
        return Layers(tuple(map(tuple, layers)), tuple(self._chains), tuple(self._returns))

    def _add_topic(self, topic: GraphTopic) -> None:
        """The topic stands right of all who publish it, or left of all who would hear it."""
        publishers = [self._nodes[name] for name in topic.publishers]
        subscribers = [self._nodes[name] for name in topic.subscribers]
        if publishers:
            beside = max(publishers, key=lambda slot: slot.layer)
            own = Slot(topic, beside.layer + 1, beside.band)
        else:
            beside = min(subscribers, key=lambda slot: slot.layer)
            own = Slot(topic, beside.layer - 1, beside.band)
        self._slots.append(own)
        section = self._sections[(*topic.publishers, *topic.subscribers)[0]]
        for name, slot in zip(topic.publishers, publishers, strict=True):
            self._join(slot, [own], self._sections[name])
        self._join(own, [slot for slot in subscribers if slot.layer > own.layer], section)
        self._returns += [
            Return(own, slot, section) for slot in subscribers if slot.layer < own.layer
        ]

    def _join(self, start: Slot, ends: list[Slot], section: str) -> None:
        """Lines from one box to several, on one common way as far as it goes."""
        way = [start]
        last = max((end.layer for end in ends), default=start.layer)
        for layer in range(start.layer + 1, last):
            way.append(Slot(None, layer, start.band))
            self._slots.append(way[-1])
            _link(way[-2], way[-1])
        for end in ends:
            passed = way[: end.layer - start.layer]
            _link(passed[-1], end)
            self._chains.append(Chain((*passed, end), section))


def _link(left: Slot, right: Slot) -> None:
    left.after.append(right)
    right.before.append(left)


def _order(layers: list[list[Slot]]) -> None:
    """Sort each layer by the middle of what its slots are joined to, sweep after sweep."""
    places = dict(_places(layers))
    for sweep in range(_SWEEPS):
        forward = sweep % 2 == 0
        for layer in layers if forward else reversed(layers):

            def wish(slot: Slot, forward: bool = forward) -> tuple[int, float]:
                beside = slot.before if forward else slot.after
                middle = sum(places[s] for s in beside) / len(beside) if beside else places[slot]
                return slot.band, middle

            layer.sort(key=wish)
            places.update(_places([layer]))


def _places(layers: list[list[Slot]]) -> Iterator[tuple[Slot, float]]:
    """Each slot's place in its layer, 0 at the top to 1 at the bottom."""
    for layer in layers:
        yield from ((slot, (i + 0.5) / len(layer)) for i, slot in enumerate(layer))
