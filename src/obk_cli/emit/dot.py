"""The graph in the DOT language of Graphviz.

Boxes have a minimum size for a font in which all letters have one width. The layout then does not
depend on the fonts of a machine. Source: https://graphviz.org/doc/info/lang.html
"""

from collections.abc import Iterable, Iterator
from typing import Final

from obk_cli.emit.graph import SECTION_COLOURS, Graph, GraphNode, GraphTopic
from obk_cli.terminal import columns_of, printable, shortened

__all__ = ["FONT_SIZE", "emit_dot"]

FONT_SIZE: Final = 11
_LETTER: Final = 0.64
"""Width of a letter as part of the font size; a little more than common fonts take."""
_LINE: Final = 1.2
"""Height of a line as part of the font size, as Graphviz has it."""
_PADDING: Final = 12
_LONGEST: Final = 44
"""Columns of a line that are shown."""
_PER_INCH: Final = 72

# In a quoted text Graphviz reads `\` sequences and HTML's entities.
_ESCAPES = str.maketrans({"\\": "\\\\", '"': '\\"', "&": "&amp;"})


def emit_dot(graph: Graph, *, spare_line: str = "") -> str:
    """The text of the graph.

    Args:
        graph: the stack.
        spare_line: a last line for every box, to be replaced later; empty: none.
    """
    return "".join(f"{line}\n" for line in _lines(graph, spare_line))


def _lines(graph: Graph, spare_line: str) -> Iterator[str]:
    ids = {node.name: f"node{i}" for i, node in enumerate(graph.nodes)}
    topics = {topic.name: f"topic{i}" for i, topic in enumerate(graph.topics)}
    yield f"digraph {_text([printable(graph.name)])} {{"
    yield f'  graph [rankdir=LR, labelloc=t, fontname="Helvetica", label={_text([graph.title])}];'
    yield f'  node [fontname="DejaVu Sans Mono", fontsize={FONT_SIZE}, fontcolor="#1b1f24"];'
    yield "  edge [arrowsize=0.7];"
    for i, device in enumerate(graph.devices):
        yield f"  subgraph cluster_{i} {{"
        yield (
            f"    label={_text([printable(device)])}; labeljust=l; style=rounded; "
            'bgcolor="#f6f8fa"; color="#d0d7de"; fontsize=12;'
        )
        for node in graph.nodes:
            if node.device == device:
                yield f"    {ids[node.name]} [{_node_attributes(node, ids, spare_line)}];"
        for topic in graph.topics_within(device):
            yield f"    {topics[topic.name]} [{_topic_attributes(topic, topics, spare_line)}];"
        yield "  }"
    for topic in graph.topics_within(None):
        yield f"  {topics[topic.name]} [{_topic_attributes(topic, topics, spare_line)}];"
    sections = {node.name: node.section for node in graph.nodes}
    for topic in graph.topics:
        for name in topic.publishers:
            yield f"  {ids[name]} -> {topics[topic.name]} [{_colour(sections[name])}];"
        for name in topic.subscribers:
            section = sections[topic.publishers[0] if topic.publishers else name]
            yield f"  {topics[topic.name]} -> {ids[name]} [{_colour(section)}];"
    yield "}"


def _node_attributes(node: GraphNode, ids: dict[str, str], spare_line: str) -> str:
    colour = SECTION_COLOURS[node.section]
    return (
        f'id={ids[node.name]}, class="{node.section}", shape=box, style=filled, penwidth=1.5, '
        f'fillcolor="{colour.light}", color="{colour.dark}", '
        + _label((node.title, node.section, *node.facts), spare_line)
    )


def _topic_attributes(topic: GraphTopic, ids: dict[str, str], spare_line: str) -> str:
    is_whole = topic.publishers and topic.subscribers
    style = "filled,rounded" if is_whole else "filled,rounded,dashed"
    return (
        f'id={ids[topic.name]}, class="topic", shape=box, style="{style}", '
        'fillcolor="#ffffff", color="#8c959f", '
        + _label((topic.title, topic.summary, *topic.sensors), spare_line)
    )


def _label(lines: tuple[str, ...], spare_line: str) -> str:
    """The label, and the size of a box that holds it [inch]."""
    shown = [shortened(line, _LONGEST) for line in (*lines, *filter(None, [spare_line]))]
    width = max(map(columns_of, shown)) * FONT_SIZE * _LETTER + 2 * _PADDING
    height = len(shown) * FONT_SIZE * _LINE + _PADDING
    size = f"width={width / _PER_INCH:.3f}, height={height / _PER_INCH:.3f}"
    return f"{size}, label={_text(shown)}"


def _colour(section: str) -> str:
    return f'color="{SECTION_COLOURS[section].dark}"'


def _text(lines: Iterable[str]) -> str:
    return '"' + "\\n".join(line.translate(_ESCAPES) for line in lines) + '"'
