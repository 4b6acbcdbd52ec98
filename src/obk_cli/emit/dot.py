"""The graph in the DOT language of Graphviz.

Source: https://graphviz.org/doc/info/lang.html
"""

from collections.abc import Iterable, Iterator

from obk_cli.emit.colours import SECTION_COLOURS
from obk_cli.emit.graph import Graph, GraphNode, GraphTopic
from obk_cli.emit.text_width import printable

__all__ = ["emit_dot"]

# In a quoted text Graphviz reads `\` sequences and HTML's entities.
_ESCAPES = str.maketrans({"\\": "\\\\", '"': '\\"', "&": "&amp;"})


def emit_dot(graph: Graph) -> str:
    """The text of the graph."""
    return "".join(f"{line}\n" for line in _lines(graph))


def _lines(graph: Graph) -> Iterator[str]:
    ids = {node.name: f"node{i}" for i, node in enumerate(graph.nodes)}
    topics = {topic.name: f"topic{i}" for i, topic in enumerate(graph.topics)}
    yield f"digraph {_text([printable(graph.name)])} {{"
    yield f'  graph [rankdir=LR, labelloc=t, fontname="Helvetica", label={_text([graph.title])}];'
    yield '  node [fontname="Helvetica", fontsize=11];'
    yield "  edge [color=gray40, arrowsize=0.7];"
    for i, device in enumerate(graph.devices):
        yield f"  subgraph cluster_{i} {{"
        yield f"    label={_text([printable(device)])}; labeljust=l; style=rounded; color=gray70;"
        for node in graph.nodes:
            if node.device == device:
                yield f"    {ids[node.name]} [{_node_attributes(node)}];"
        for topic in graph.topics_within(device):
            yield f"    {topics[topic.name]} [{_topic_attributes(topic)}];"
        yield "  }"
    for topic in graph.topics_within(None):
        yield f"  {topics[topic.name]} [{_topic_attributes(topic)}];"
    for topic in graph.topics:
        for name in topic.publishers:
            yield f"  {ids[name]} -> {topics[topic.name]};"
        for name in topic.subscribers:
            yield f"  {topics[topic.name]} -> {ids[name]};"
    yield "}"


def _node_attributes(node: GraphNode) -> str:
    colour = SECTION_COLOURS[node.section]
    label = _text((node.title, *node.facts))
    return f'shape=box, style=filled, fillcolor="{colour.light}", color="{colour.dark}", ' + (
        f"label={label}"
    )


def _topic_attributes(topic: GraphTopic) -> str:
    label = _text((topic.title, topic.summary, *topic.sensors))
    return f"shape=box, style=rounded, color=gray60, fontsize=10, label={label}"


def _text(lines: Iterable[str]) -> str:
    return '"' + "\\n".join(line.translate(_ESCAPES) for line in lines) + '"'
