"""The graph as a Mermaid flow chart, which many web pages and editors render.

Source: https://mermaid.js.org/syntax/flowchart.html
"""

import json
from collections.abc import Iterator

from obk_cli.emit.graph import SECTION_COLOURS, Graph, GraphNode, GraphTopic
from obk_cli.terminal import printable

__all__ = ["emit_mermaid"]

_ENTITIES = str.maketrans(
    {"#": "#35;", '"': "#quot;", "<": "#lt;", ">": "#gt;", "&": "#amp;", "`": "#96;", "\\": "#92;"}
)


def emit_mermaid(graph: Graph) -> str:
    """The graph as a flow chart."""
    return "".join(f"{line}\n" for line in _lines(graph))


def _lines(graph: Graph) -> Iterator[str]:
    ids = {node.name: f"node{i}" for i, node in enumerate(graph.nodes)}
    topics = {topic.name: f"topic{i}" for i, topic in enumerate(graph.topics)}
    yield from ("---", f"title: {json.dumps(graph.title, ensure_ascii=False)}", "---")
    yield "flowchart LR"
    for i, device in enumerate(graph.devices):
        yield f'  subgraph device{i}["{_escape(printable(device))}"]'
        for node in graph.nodes:
            if node.device == device:
                yield f'    {ids[node.name]}["{_node_label(node)}"]:::{node.section}'
        for topic in graph.topics_within(device):
            yield f"    {topics[topic.name]}{_topic_box(topic)}"
        yield "  end"
    for topic in graph.topics_within(None):
        yield f"  {topics[topic.name]}{_topic_box(topic)}"
    for topic in graph.topics:
        for name in topic.publishers:
            yield f"  {ids[name]} --> {topics[topic.name]}"
        for name in topic.subscribers:
            yield f"  {topics[topic.name]} --> {ids[name]}"
    for section in dict.fromkeys(node.section for node in graph.nodes):
        colour = SECTION_COLOURS[section]
        yield f"  classDef {section} fill:{colour.light},stroke:{colour.dark},color:#1b1f24"
    yield "  classDef topic fill:#ffffff,stroke:#8c959f,color:#1b1f24"


def _node_label(node: GraphNode) -> str:
    return f"<b>{_escape(node.title)}</b><br/>" + "<br/>".join(map(_escape, node.facts))


def _topic_box(topic: GraphTopic) -> str:
    label = "<br/>".join(map(_escape, (topic.title, topic.summary, *topic.sensors)))
    return f'(["{label}"]):::topic'


def _escape(text: str) -> str:
    return text.translate(_ENTITIES)
