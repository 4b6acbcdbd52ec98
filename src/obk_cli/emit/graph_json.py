"""The graph as JSON, for tools that draw or check it themselves."""

from collections.abc import Iterator
from dataclasses import asdict

from obk_cli.emit.graph import Graph
from obk_cli.emit.json_text import json_text

__all__ = ["emit_graph_json"]


def emit_graph_json(graph: Graph) -> str:
    """The text: `name`, `devices`, `nodes`, `topics`, and `edges` from node to topic to node."""
    topics = [asdict(topic) for topic in graph.topics]
    for topic in topics:  # said by the edges
        del topic["publishers"], topic["subscribers"]
    return json_text(
        {
            "name": graph.name,
            "devices": graph.devices,
            "nodes": [asdict(node) for node in graph.nodes],
            "topics": topics,
            "edges": list(_edges(graph)),
        }
    )


def _edges(graph: Graph) -> Iterator[dict[str, str]]:
    for topic in graph.topics:
        for node in topic.publishers:
            yield {"kind": "publishes", "from": node, "to": topic.name}
        for node in topic.subscribers:
            yield {"kind": "subscribes", "from": topic.name, "to": node}
