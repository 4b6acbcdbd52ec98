"""In which column of a picture each node stands: data flows to the right, robot first.

A graph in, a number for each node out. Knows nothing of sizes.
"""

from collections.abc import Mapping
from typing import Final

from obk_cli.emit.graph import Graph

__all__ = ["rank_nodes"]

_COLUMNS: Final = {
    "robot": 0,
    "sensing": 1,
    "estimation": 2,
    "joystick": 2,  # what it says is for the control
    "control": 3,
    "viz": 4,
}


def rank_nodes(graph: Graph) -> Mapping[str, int]:
    """Full name -> column, from 0 and without gaps.

    Within a section a node stands right of those that it hears, as far as they are in no circle.
    """
    ranks: dict[str, int] = {}
    first = 0
    for column in sorted(set(_COLUMNS.values())):
        names = [n.name for n in graph.nodes if _COLUMNS[n.section] == column]
        depths = _depths(names, _hears(graph, set(names)))
        ranks.update((name, first + depth) for name, depth in depths.items())
        first += 1 + max(depths.values()) if depths else 0
    return ranks


def _hears(graph: Graph, names: set[str]) -> Mapping[str, list[str]]:
    """Node -> the nodes that it hears, both among `names`."""
    heard: dict[str, list[str]] = {name: [] for name in names}
    for topic in graph.topics:
        for subscriber in names.intersection(topic.subscribers):
            heard[subscriber] += [name for name in topic.publishers if name in names]
    return heard


def _depths(names: list[str], heard: Mapping[str, list[str]]) -> dict[str, int]:
    """The longest way to each node; an edge that would close a circle does not count."""
    depths: dict[str, int] = {}
    for start in names:
        way = [start]
        while way:  # no recursion: a config may chain a thousand nodes
            node = way[-1]
            deeper = next((n for n in heard[node] if n not in depths and n not in way), None)
            if deeper is not None:
                way.append(deeper)
                continue
            way.pop()
            if node not in depths:
                known = (depths[n] for n in heard[node] if n in depths)
                depths[node] = 1 + max(known, default=-1)
    return depths
