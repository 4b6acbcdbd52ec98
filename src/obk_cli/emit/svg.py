"""The graph as an SVG picture, laid out and drawn here: needs no other program.

Letters are of one width, so that boxes fit whatever font stands in. A live picture has the names of
nodes and topics as data attributes, and an empty last line in every box for what is measured.
"""

from collections.abc import Iterator
from html import escape
from itertools import pairwise

from obk_cli.emit.colours import SECTION_COLOURS
from obk_cli.emit.graph import Graph, GraphNode, GraphTopic
from obk_cli.emit.layout import Band, Box, Layout, Way, lay_out
from obk_cli.emit.text_width import columns_of, printable, shortened

__all__ = ["emit_svg"]

_FONT = "ui-monospace, 'DejaVu Sans Mono', Menlo, Consolas, monospace"
_LETTER = 0.64
"""Width of a letter, as part of the font's size; a little more than any of the fonts takes."""
_MARGIN = 24.0
_HEADING = 46.0
_PADDING = 12.0
_TITLE_PX = 13.0
_TEXT_PX = 11.0
_LINE_PX = 16.0
_LONGEST = 44
"""Letters of a line that are shown; the whole text is in the box's tooltip."""
_CORNER = 7.0
_LIVE_LETTERS = 22
"""Of what a page fills in: `1000 of 1000 Hz`."""


def emit_svg(graph: Graph, *, is_live: bool = False) -> str:
    """The text of the picture.

    Args:
        graph: the stack.
        is_live: whether boxes have a line that a page fills: `text.live` within the group whose
            `data-node` or `data-topic` is the full name.
    """
    layout = lay_out(graph, _live_size if is_live else _size)
    return "".join(f"{line}\n" for line in _lines(graph, layout, is_live))


def _lines(graph: Graph, layout: Layout, is_live: bool) -> Iterator[str]:
    title_width = _text_width(graph.title, 16)
    width = max(layout.width, title_width) + 2 * _MARGIN
    height = layout.height + _HEADING + 2 * _MARGIN
    yield (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}" font-family="{_FONT}" role="img">'
    )
    yield f"<title>{escape(graph.title)}</title>"
    yield f'<rect width="{width:.0f}" height="{height:.0f}" fill="#ffffff"/>'
    yield _text(graph.title, _MARGIN, _MARGIN + 16, 16, "#1b1f24", bold=True)
    yield f'<g transform="translate({_n(_MARGIN)} {_n(_MARGIN + _HEADING)})">'
    # Left of the first box lines may pass.
    heading_x = min((box.x for box in layout.boxes), default=0.0)
    for band in layout.bands:
        yield from _band(band, layout.width, heading_x)
    # Those that run back first: they cross below the others.
    for way in sorted(layout.ways, key=lambda way: not way.is_return):
        yield from _way(way)
    for box in layout.boxes:
        yield from _box(box, is_live)
    yield from ("</g>", "</svg>")


def _size(item: GraphNode | GraphTopic) -> tuple[float, float]:
    title, lines = _content(item)
    widths = (_text_width(title, _TITLE_PX), *(_text_width(line, _TEXT_PX) for line in lines))
    return max(widths) + 2 * _PADDING, (1 + len(lines)) * _LINE_PX + 14


def _live_size(item: GraphNode | GraphTopic) -> tuple[float, float]:
    width, height = _size(item)
    return max(width, _text_width("0" * _LIVE_LETTERS, _TEXT_PX)), height + _LINE_PX


def _content(item: GraphNode | GraphTopic) -> tuple[str, tuple[str, ...]]:
    """What a box says: its title, and the lines below."""
    lines = item.facts if isinstance(item, GraphNode) else (item.summary, *item.sensors)
    if isinstance(item, GraphNode):
        lines = (item.section, *lines)
    return shortened(item.title, _LONGEST), tuple(shortened(line, _LONGEST) for line in lines)


def _band(band: Band, width: float, heading_x: float) -> Iterator[str]:
    yield (
        f'<rect x="0" y="{_n(band.y)}" width="{_n(width)}" height="{_n(band.height)}" rx="10" '
        'fill="#f6f8fa" stroke="#d0d7de"/>'
    )
    yield _text(printable(band.device), heading_x, band.y + 20, 12, "#57606a", bold=True)


def _box(box: Box, is_live: bool) -> Iterator[str]:
    kind = "node" if isinstance(box.item, GraphNode) else "topic"
    group = f'<g data-{kind}="{escape(box.item.name)}">' if is_live else "<g>"
    yield f"{group}<title>{escape(_tooltip(box.item))}</title>"
    yield from _node(box) if isinstance(box.item, GraphNode) else _topic(box)
    if is_live:
        x, y = box.x + _PADDING, box.y + box.height - _PADDING
        yield f'<text class="live" x="{_n(x)}" y="{_n(y)}" font-size="{_n(_TEXT_PX)}"></text>'
    yield "</g>"


def _node(box: Box) -> Iterator[str]:
    assert isinstance(box.item, GraphNode)
    colour = SECTION_COLOURS[box.item.section]
    title, (section, *facts) = _content(box.item)
    yield _rect(box, 6, f'fill="{colour.light}" stroke="{colour.dark}" stroke-width="1.5"')
    x, y = box.x + _PADDING, box.y + _LINE_PX + 3
    yield _text(title, x, y, _TITLE_PX, "#1b1f24", bold=True)
    yield _text(section, x, y + _LINE_PX, _TEXT_PX, colour.dark, bold=True)
    for i, fact in enumerate(facts):
        yield _text(fact, x, y + (i + 2) * _LINE_PX, _TEXT_PX, "#3d444d")


def _topic(box: Box) -> Iterator[str]:
    assert isinstance(box.item, GraphTopic)
    title, (summary, *sensors) = _content(box.item)
    is_whole = box.item.publishers and box.item.subscribers
    dashes = "" if is_whole else ' stroke-dasharray="4 3"'
    yield _rect(box, 16, f'fill="#ffffff" stroke="#8c959f"{dashes}')
    x, y = box.x + _PADDING, box.y + _LINE_PX + 3
    yield _text(title, x, y, _TEXT_PX, "#1b1f24", bold=True)
    yield _text(summary, x, y + _LINE_PX, _TEXT_PX, "#3d444d")
    for i, sensor in enumerate(sensors):
        yield _text(sensor, x, y + (i + 2) * _LINE_PX, _TEXT_PX, SECTION_COLOURS["robot"].dark)


def _tooltip(item: GraphNode | GraphTopic) -> str:
    if isinstance(item, GraphNode):
        return "\n".join((item.title, *item.facts))
    return _topic_tooltip(item)


def _topic_tooltip(topic: GraphTopic) -> str:
    lines = [topic.title, topic.msg_type or topic.summary]
    for group in topic.sensor_groups:
        lines += [f"{kind} {name}" for name, kind in group.sensors.items()]
    if not topic.subscribers:
        lines.append("nothing in the config reads it")
    if not topic.publishers:
        lines.append("nothing in the config publishes it")
    return "\n".join(map(printable, lines))


def _way(way: Way) -> Iterator[str]:
    colour = SECTION_COLOURS[way.section].dark
    path = _corners(way) if way.is_return else _bends(way)
    yield f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.5"/>'
    if way.has_arrow:
        x, y = way.points[-1]
        yield f'<path d="M{_n(x)} {_n(y)}l-9 -4v8z" fill="{colour}"/>'


def _bends(way: Way) -> str:
    """A bend between two layers, a straight line through one, in turn."""
    (x, y), *_ = way.points
    parts = [f"M{_n(x)} {_n(y)}"]
    for i, ((x0, y0), (x1, y1)) in enumerate(pairwise(way.points)):
        middle = _n((x0 + x1) / 2)
        is_bend = i % 2 == 0
        parts.append(
            f"C{middle} {_n(y0)} {middle} {_n(y1)} {_n(x1)} {_n(y1)}" if is_bend else f"H{_n(x1)}"
        )
    return "".join(parts)


def _corners(way: Way) -> str:
    """Right angles with round corners."""
    first, *inner, last = way.points
    parts = [f"M{_n(first[0])} {_n(first[1])}"]
    for before, (x, y), after in zip((first, *inner), inner, (*inner[1:], last), strict=False):
        start, end = _towards((x, y), before), _towards((x, y), after)
        parts.append(f"L{_n(start[0])} {_n(start[1])}Q{_n(x)} {_n(y)} {_n(end[0])} {_n(end[1])}")
    return "".join((*parts, f"L{_n(last[0])} {_n(last[1])}"))


def _towards(corner: tuple[float, float], point: tuple[float, float]) -> tuple[float, float]:
    """The place a little off a corner, on the straight line to a point."""
    (x, y), (to_x, to_y) = corner, point
    length = abs(to_x - x) + abs(to_y - y)
    share = min(_CORNER / length, 0.5) if length else 0.0
    return x + (to_x - x) * share, y + (to_y - y) * share


def _rect(box: Box, radius: float, style: str) -> str:
    return (
        f'<rect x="{_n(box.x)}" y="{_n(box.y)}" width="{_n(box.width)}" '
        f'height="{_n(box.height)}" rx="{_n(radius)}" {style}/>'
    )


def _text(text: str, x: float, y: float, size: float, fill: str, *, bold: bool = False) -> str:
    weight = ' font-weight="600"' if bold else ""
    return (
        f'<text x="{_n(x)}" y="{_n(y)}" font-size="{_n(size)}" fill="{fill}"{weight}>'
        f"{escape(text)}</text>"
    )


def _text_width(text: str, size: float) -> float:
    return columns_of(text) * size * _LETTER


def _n(value: float) -> str:
    """A coordinate, without what no eye sees."""
    return f"{value:.1f}".removesuffix(".0")
