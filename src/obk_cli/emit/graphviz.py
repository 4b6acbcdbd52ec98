"""The graph in the DOT language of Graphviz, and rendered as SVG or PNG.

Boxes have a minimum size for a monospace font, so the layout does not depend on the machine's
fonts. Source: https://graphviz.org/doc/info/lang.html

In an SVG every box is a `<g>` with the item's full name as `data-node` or `data-topic`, and with
its section or `topic` as a class. Each box of a live diagram has an empty `text.live`, which a page
fills with measured values. Only rendering needs the `graph` extra.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, Literal
from xml.etree import ElementTree

from obk_cli.emit.graph import SECTION_COLOURS, Graph, GraphNode, GraphTopic
from obk_cli.errors import CommandFailedError
from obk_cli.optional_deps import require_extra
from obk_cli.terminal import columns_of, printable, shortened

__all__ = ["emit_dot", "emit_png", "emit_svg"]


FONT_SIZE: Final = 11
_LETTER: Final = 0.64
"""Width of a letter relative to the font size; slightly more than in common fonts."""
_LINE: Final = 1.2
"""Height of a line relative to the font size, as in Graphviz."""
_PADDING: Final = 12
_LONGEST: Final = 44
"""Maximum number of columns shown of a line."""
_PER_INCH: Final = 72

# Graphviz interprets `\` sequences and HTML entities in quoted text.
_ESCAPES = str.maketrans({"\\": "\\\\", '"': '\\"', "&": "&amp;"})
_FONT: Final = "ui-monospace, 'DejaVu Sans Mono', Menlo, Consolas, monospace"
_NAMESPACE: Final = ' xmlns="http://www.w3.org/2000/svg"'
_SPARE_LINE: Final = "1000 of 1000 Hz stale"
"""As long as the longest text that a page fills in."""
_LINE_PX: Final = _LINE * FONT_SIZE
_BASELINE: Final = 0.35
"""From the middle of a line to its baseline, relative to the font size."""
# Graphviz is written in C and prints warnings about fonts, so it runs in its own process. Boxes
# have the sizes of the DOT text, whatever the fonts of the machine.
_PROGRAM: Final = """
import sys, pygraphviz
graph = pygraphviz.AGraph(string=sys.stdin.buffer.read().decode())
graph.node_attr["fixedsize"] = "true"
graph.graph_attr["dpi"] = sys.argv[2]
sys.stdout.buffer.write(graph.draw(format=sys.argv[1], prog="dot"))
"""
_NO_FONTS: Final = "<fontconfig></fontconfig>\n"
_DRAW_S: Final = 60.0
_DPI: Final = {"svg": 72, "png": 144}
"""A point of an SVG is one pixel; a PNG has twice the resolution."""
_FONT_FOLDERS: Final = ("/usr/share/fonts", "/usr/local/share/fonts", "~/.local/share/fonts")
_FONT_ENDINGS: Final = (".ttf", ".otf", ".ttc", ".pfb")


def emit_dot(graph: Graph, *, spare_line: str = "") -> str:
    """The graph as DOT text.

    Args:
        graph: the stack.
        spare_line: a last line for every box, to be replaced later; empty for none.
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


def emit_svg(graph: Graph, *, is_live: bool = False) -> str:
    """The graph as SVG text.

    Args:
        graph: the stack.
        is_live: whether every box has an empty last line for a page to fill.

    Raises:
        CommandFailedError: the `graph` extra is not installed, or Graphviz failed.
    """
    drawn = draw(emit_dot(graph, spare_line=_SPARE_LINE if is_live else ""), "svg").decode()
    # Without a namespace, tag names stay plain when the tree is parsed and written.
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
    """Add the item's name to a box, style its lines, and clear the line that a page fills."""
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
    """Move a frame's heading to its left edge, independently of the machine's fonts."""
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


def emit_png(graph: Graph) -> bytes:
    """The graph as a PNG, with the fonts of this machine.

    Raises:
        CommandFailedError: the `graph` extra is not installed, no font is installed, or Graphviz
            failed.
    """
    folders = [Path(folder).expanduser() for folder in _FONT_FOLDERS]
    files = (file for folder in folders for file in folder.rglob("*"))
    if not any(file.suffix.lower() in _FONT_ENDINGS for file in files):
        raise CommandFailedError(
            "a PNG needs a font, and this machine has none",
            help="install one, such as the package `fonts-dejavu-core`, or draw an SVG",
        )
    return draw(emit_dot(graph), "png")


def draw(dot: str, form: Literal["svg", "png"]) -> bytes:
    """Render a DOT text; an SVG has the same layout on every machine.

    Raises:
        CommandFailedError: the `graph` extra is not installed, or Graphviz failed.
    """
    require_extra("pygraphviz", "graph")
    environment = dict(os.environ)
    try:
        with tempfile.TemporaryDirectory(prefix="obk-graph-") as folder:
            if form == "svg":  # the viewer draws the text
                fonts = Path(folder, "fonts.conf")
                fonts.write_text(_NO_FONTS, encoding="utf-8")
                environment["FONTCONFIG_FILE"] = str(fonts)
            ended = subprocess.run(
                (sys.executable, "-P", "-c", _PROGRAM, form, str(_DPI[form])),
                capture_output=True,
                check=False,
                env=environment,
                input=dot.encode(),
                timeout=_DRAW_S,
            )
    except subprocess.TimeoutExpired as error:
        raise CommandFailedError(
            f"Graphviz did not finish within {_DRAW_S:.0f} s", help="`--to dot` needs no layout"
        ) from error
    if ended.returncode != 0:
        last = ended.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        raise CommandFailedError(f"Graphviz failed: {last or f'exit code {ended.returncode}'}")
    return ended.stdout
