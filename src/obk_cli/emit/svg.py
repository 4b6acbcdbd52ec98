"""The graph as an SVG picture: Graphviz draws what `emit_dot` writes, by the extra `graph`.

Every box is a `<g>` with the item's full name as `data-node` or `data-topic`, and with its section
or `topic` as a class. A live picture has an empty `text.live` in each for what a page measures.
"""

from typing import Final
from xml.etree import ElementTree

from obk_cli.emit.dot import FONT_SIZE, emit_dot
from obk_cli.emit.graph import SECTION_COLOURS, Graph, GraphNode, GraphTopic
from obk_cli.emit.graphviz import draw
from obk_cli.terminal import printable

__all__ = ["emit_svg"]

_FONT: Final = "ui-monospace, 'DejaVu Sans Mono', Menlo, Consolas, monospace"
_NAMESPACE: Final = ' xmlns="http://www.w3.org/2000/svg"'
_SPARE_LINE: Final = "1000 of 1000 Hz stale"
"""As long as the longest text that a page fills in."""
_PADDING: Final = 12
_LINE_PX: Final = 1.2 * FONT_SIZE
_BASELINE: Final = 0.35
"""From the middle of a line to its baseline, as part of the font size."""


def emit_svg(graph: Graph, *, is_live: bool = False) -> str:
    """The text of the picture.

    Args:
        graph: the stack.
        is_live: whether every box has an empty last line for a page to fill.

    Raises:
        CommandFailedError: the extra `graph` is not installed, or Graphviz failed.
    """
    drawn = draw(emit_dot(graph, spare_line=_SPARE_LINE if is_live else ""), "svg").decode()
    # Without a namespace the tree has plain names, in and out.
    root = ElementTree.fromstring(drawn.replace(_NAMESPACE, "", 1))
    items: dict[str, GraphNode | GraphTopic] = {}
    items |= {f"node{i}": node for i, node in enumerate(graph.nodes)}
    items |= {f"topic{i}": topic for i, topic in enumerate(graph.topics)}
    _set_head(root, graph)
    for group in root.iter("g"):
        item = items.get(group.get("id", ""))
        if item is not None:
            _finish_box(group, item, is_live=is_live)
        elif group.get("class") == "cluster":
            _align_left(group)
        elif group.get("class") == "edge":
            group.remove(group.findall("title")[0])
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _set_head(root: ElementTree.Element, graph: Graph) -> None:
    root.set("xmlns", "http://www.w3.org/2000/svg")
    root.set("role", "img")
    root.set("font-family", _FONT)
    for side in ("width", "height"):  # a point of Graphviz is a pixel here
        root.set(side, root.get(side, "").removesuffix("pt"))
    for text in root.iter("text"):
        text.attrib.pop("font-family", None)
        text.attrib.pop("{http://www.w3.org/XML/1998/namespace}space", None)
    canvas = root.findall("g")[0]
    canvas.findall("title")[0].text = graph.title
    for text in canvas.findall("text"):
        text.set("font-weight", "600")
        text.set("fill", "#1b1f24")


def _finish_box(group: ElementTree.Element, item: GraphNode | GraphTopic, *, is_live: bool) -> None:
    """Name the item of a box, style its lines, and clear the line that a page fills."""
    group.set("data-node" if isinstance(item, GraphNode) else "data-topic", printable(item.name))
    group.findall("title")[0].text = _tooltip(item)
    title, *lines = group.findall("text")
    _, top, _, bottom = _bounds(group)
    for i, text in enumerate((title, *lines)):
        y = (top + bottom) / 2 + (i - len(lines) / 2) * _LINE_PX + _BASELINE * FONT_SIZE
        text.set("y", f"{y:.2f}")
    title.set("font-weight", "600")
    if is_live:
        live = lines.pop()
        live.set("class", "live")
        live.text = ""
    if isinstance(item, GraphNode):
        lines[0].set("font-weight", "600")
        lines[0].set("fill", SECTION_COLOURS[item.section].dark)
    for line in lines[1:]:
        line.set("fill", "#3d444d")


def _align_left(cluster: ElementTree.Element) -> None:
    """Put a frame's heading at its left edge, wherever the fonts of the machine had it."""
    left, *_ = _bounds(cluster)
    for text in cluster.findall("text"):
        text.set("text-anchor", "start")
        text.set("x", f"{left + _PADDING:g}")
        text.set("font-size", str(FONT_SIZE + 1))
        text.set("font-weight", "600")
        text.set("fill", "#57606a")


def _bounds(group: ElementTree.Element) -> tuple[float, float, float, float]:
    """Left, top, right and bottom of the outline of a group."""
    outline = next(shape for shape in group if shape.tag in ("path", "polygon"))
    text = outline.get("d", "") or outline.get("points", "")
    points = [point.split(",") for point in text.replace("M", " ").replace("C", " ").split()]
    xs, ys = [float(x) for x, _ in points], [float(y) for _, y in points]
    return min(xs), min(ys), max(xs), max(ys)


def _tooltip(item: GraphNode | GraphTopic) -> str:
    if isinstance(item, GraphNode):
        return "\n".join((item.title, item.section, *item.facts))
    lines = [item.title, item.msg_type or item.summary]
    for group in item.sensor_groups:
        lines += [f"{kind} {name}" for name, kind in group.sensors.items()]
    if not item.subscribers:
        lines.append("no subscriber in the config")
    if not item.publishers:
        lines.append("no publisher in the config")
    return "\n".join(map(printable, lines))
