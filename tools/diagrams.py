"""Draw boxes and arrows on a grid as SVG, without fonts or scripts, for the design diagrams."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape

__all__ = ["Arrow", "Box", "Frame", "draw"]

WIDTH, HEIGHT = 168, 66
GAP_X, GAP_Y = 40, 46
MARGIN = 22
LINE = 15
FONT = "ui-sans-serif, system-ui, 'DejaVu Sans', Helvetica, Arial, sans-serif"
COLOURS = {
    "stage": ("#ddf4ff", "#0969da"),
    "data": ("#ffffff", "#8c959f"),
    "result": ("#dafbe1", "#1a7f37"),
    "outside": ("#fff1e5", "#bc4c00"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """A named box with lines of text below the name."""

    name: str
    lines: tuple[str, ...]
    column: float
    row: float
    kind: str = "stage"

    @property
    def x(self) -> float:
        """Position of the left side [px]."""
        return MARGIN + self.column * (WIDTH + GAP_X)

    @property
    def y(self) -> float:
        """Position of the upper side [px]."""
        return MARGIN + self.row * (HEIGHT + GAP_Y)


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrow:
    """An arrow from one box to another, by their names."""

    start: str
    end: str
    label: str = ""
    is_both_ways: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """A rectangle behind the named boxes."""

    title: str
    names: tuple[str, ...]


def draw(
    title: str, boxes: Sequence[Box], arrows: Sequence[Arrow], frames: Sequence[Frame] = ()
) -> str:
    """Draw the diagram as SVG; the title is for screen readers."""
    width = max(box.x for box in boxes) + WIDTH + MARGIN
    height = max(box.y for box in boxes) + HEIGHT + MARGIN
    named = {box.name: box for box in boxes}
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
        f'width="{width:g}" height="{height:g}" font-family="{FONT}" role="img">',
        f"<title>{escape(title)}</title>",
        f'<rect width="{width:g}" height="{height:g}" fill="#ffffff"/>',
        *(_frame(frame, named) for frame in frames),
        *(line for arrow in arrows for line in _arrow(arrow, named)),
        *(line for box in boxes for line in _box(box)),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _frame(frame: Frame, named: Mapping[str, Box]) -> str:
    boxes = [named[name] for name in frame.names]
    left, top = min(box.x for box in boxes) - 14, min(box.y for box in boxes) - 26
    right, bottom = max(box.x for box in boxes) + WIDTH, max(box.y for box in boxes) + HEIGHT
    return (
        f'<rect x="{left:g}" y="{top:g}" width="{right - left + 14:g}" '
        f'height="{bottom - top + 12:g}" rx="10" fill="#f6f8fa" stroke="#d0d7de"/>'
        + _text(frame.title, left + 12, top + 17, 11, "#57606a", "start", bold=True)
    )


def _box(box: Box) -> Iterator[str]:
    light, dark = COLOURS[box.kind]
    yield (
        f'<rect x="{box.x:g}" y="{box.y:g}" width="{WIDTH}" height="{HEIGHT}" rx="7" '
        f'fill="{light}" stroke="{dark}"/>'
    )
    x = box.x + WIDTH / 2
    y = box.y + HEIGHT / 2 - (len(box.lines)) * LINE / 2 + 4
    yield _text(box.name, x, y, 13, "#1b1f24", "middle", bold=True)
    for number, line in enumerate(box.lines, 1):
        yield _text(line, x, y + number * LINE, 10.5, "#424a53", "middle")


def _arrow(arrow: Arrow, named: Mapping[str, Box]) -> Iterator[str]:
    start, end = named[arrow.start], named[arrow.end]
    if start.row == end.row:
        is_right = start.column < end.column
        x1, x2 = (start.x + WIDTH, end.x) if is_right else (start.x, end.x + WIDTH)
        y1 = y2 = start.y + HEIGHT / 2
        path, at, turn = f"M{x1:g} {y1:g}L{x2:g} {y2:g}", (x2, y2), 0 if is_right else 180
    else:
        is_down = start.row < end.row
        x1, x2 = start.x + WIDTH / 2, end.x + WIDTH / 2
        y1, y2 = (start.y + HEIGHT, end.y) if is_down else (start.y, end.y + HEIGHT)
        middle = (y1 + y2) / 2
        path = f"M{x1:g} {y1:g}C{x1:g} {middle:g} {x2:g} {middle:g} {x2:g} {y2:g}"
        at, turn = (x2, y2), 90 if is_down else 270
    yield f'<path d="{path}" fill="none" stroke="#57606a" stroke-width="1.4"/>'
    yield _head(at, turn)
    if arrow.is_both_ways:
        yield _head((x1, y1), turn + 180)
    if arrow.label:
        x, y = (x1 + x2) / 2, (y1 + y2) / 2
        yield _text(arrow.label, x + (0 if y1 == y2 else 6), y - 5, 10, "#57606a", "middle")


def _head(at: tuple[float, float], turn: float) -> str:
    x, y = at
    return (
        f'<path d="M0 0l-8 -4v8z" fill="#57606a" '
        f'transform="translate({x:g} {y:g}) rotate({turn % 360:g})"/>'
    )


def _text(
    text: str, x: float, y: float, size: float, colour: str, anchor: str, *, bold: bool = False
) -> str:
    weight = ' font-weight="600"' if bold else ""
    return (
        f'<text x="{x:g}" y="{y:g}" font-size="{size:g}" fill="{colour}" '
        f'text-anchor="{anchor}"{weight}>{escape(text)}</text>'
    )
