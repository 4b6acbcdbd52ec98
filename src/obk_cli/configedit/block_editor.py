"""Edit a config's text in block style: add a node to a section, or replace one.

Pure: returns edits, or why the text cannot be edited. Flow style (braces, brackets), anchors on a
single node and keys written with `?` are rejected. Only a replaced node is rewritten; new lines
follow the layout of the lines around them.
"""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import Literal

from obelisk_spec.components import SETTING_SUFFIX
from obelisk_spec.yaml_core import core_scalar
from obk_cli.config.fixes import is_flow
from obk_cli.config.model import COMPONENT_LISTS, NODE_SECTIONS, Node, Stack
from obk_cli.config.tree import Entry, Tree, TreeList, TreeMap, TreeScalar
from obk_cli.config.yaml_parser import parse_source
from obk_cli.configedit.new_node import Rejected, identity_of
from obk_cli.configedit.spelling import devices_of, sections_of
from obk_cli.diagnostics.edits import Edit, Offsets
from obk_cli.diagnostics.source import SourceFile, Span, indent_of, line_end_of

__all__ = [
    "InsertionPoint",
    "index_of",
    "inline_text",
    "insert_node",
    "named_as",
    "place_of",
    "replace_node",
    "snippet_of",
]

_SECTION_ORDER = ("control", "estimation", "sensing", "robot", "viz", "joystick")
"""The usual order of sections in a config."""
_DASH = re.compile(r" *-(?= |$)")
_ANCHOR = re.compile(r"[ \t]*&")
_PLAIN = re.compile(r"[A-Za-z_/~][A-Za-z0-9_./~-]*")
_COLON = re.compile(r"[ \t]*:")


@dataclass(frozen=True, slots=True, kw_only=True)
class Style:
    """The layout of source text; widths in columns."""

    line_end: str = "\n"
    step: int = 2
    """Indentation of keys relative to the parent key."""
    section_dash: int = 2
    """Indentation of a section's dashes relative to the section."""
    dash: int = 2
    """Indentation of a list's dashes relative to its key within a node."""
    gap: int = 1
    """Spaces after a dash."""
    naming: Literal["ros_parameter", "key"] = "key"


def _style_of(source: SourceFile, tree: TreeMap, section: str) -> Style:
    """The layout of source text, taken from its nodes of `section` if it has any."""
    sections = sorted(_sections(tree), key=lambda entry: entry.key != section)
    nodes = [node for entry in sections for node in _maps(entry.value)]
    lists = [e for node in nodes for e in node if e.key in COMPONENT_LISTS]
    components = [c for entry in lists for c in _maps(entry.value)]
    steps = _steps((*devices_of(tree), *sections, *(e for node in nodes for e in node)))
    dash = next(_dashes(lists), None)
    section_dash = next(_dashes(sections), dash)
    usual = Style()
    return Style(
        line_end=line_end_of(source.text),
        step=next(steps, usual.step),
        section_dash=usual.section_dash if section_dash is None else section_dash,
        dash=next((d for d in (dash, section_dash) if d is not None), usual.dash),
        gap=next(_gaps((*lists, *sections)), usual.gap),
        naming="ros_parameter" if _uses_parameters(components) else "key",
    )


def _sections(tree: TreeMap) -> Iterator[Entry]:
    for holder in (tree, *(device.value for device in devices_of(tree))):
        if isinstance(holder, TreeMap):
            yield from (entry for entry in sections_of(holder) if entry.key in NODE_SECTIONS)


def _maps(tree: Tree) -> list[TreeMap]:
    items = tree.items if isinstance(tree, TreeList) else (tree,)
    return [item for item in items if isinstance(item, TreeMap)]


def _steps(entries: tuple[Entry, ...]) -> Iterator[int]:
    for entry in entries:
        value = entry.value
        if isinstance(value, TreeMap) and not is_flow(value) and value.entries:
            first = value.entries[0].key_span
            if first.line > entry.key_span.line and first.column > entry.key_span.column:
                yield first.column - entry.key_span.column


def _dashes(entries: list[Entry]) -> Iterator[int]:
    for entry in entries:
        value = entry.value
        if isinstance(value, TreeList) and not is_flow(value):
            width = value.span.column - entry.key_span.column
            if value.span.line > entry.key_span.line and width >= 0:
                yield width


def _gaps(entries: tuple[Entry, ...]) -> Iterator[int]:
    for entry in entries:
        if isinstance(entry.value, TreeList) and not is_flow(entry.value):
            for item in _maps(entry.value):
                line = item.span.source.line(item.span.line)
                behind = re.match(r" *-( +)", line)
                if behind is not None and behind.end() == item.span.column - 1:
                    yield len(behind[1])


def _uses_parameters(components: list[TreeMap]) -> bool:
    named = [c for c in components if c.get("ros_parameter") or c.get("key")]
    return bool(named) and named[0].get("ros_parameter") is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class InsertionPoint:
    """Where to insert a node."""

    tree: TreeMap
    """The tree of the whole text."""
    section: str
    device: Entry | None = None
    """The block that contains the section; None for sections at the top level."""
    new_device: str | None = None
    """The device whose block must be created for it."""
    style: Style

    @property
    def holder(self) -> TreeMap:
        """The mapping that contains, or will contain, the section."""
        value = self.device.value if self.device else self.tree
        assert isinstance(value, TreeMap)  # a device block is a mapping
        return value

    @property
    def entry(self) -> Entry | None:
        """The section; None if it does not exist."""
        return None if self.new_device else self.holder.get(self.section)


def place_of(tree: TreeMap, stack: Stack, section: str, device: str) -> InsertionPoint:
    """The insertion point for a section on a device, in a new block if devices have blocks."""
    blocks = {entry.key: entry for entry in devices_of(tree)}
    has_levels = device not in blocks and not sections_of(tree) and _has_blocks(stack)
    return InsertionPoint(
        tree=tree,
        section=section,
        device=blocks.get(device),
        new_device=device if has_levels else None,
        style=_style_of(tree.span.source, tree, section),
    )


def index_of(place: InsertionPoint, old: Node) -> int | Rejected:
    """The index of the node to replace within its section."""
    value = place.entry.value if place.entry else None
    items = value.items if isinstance(value, TreeList) else (value,)
    for index, item in enumerate(items):
        if isinstance(item, TreeMap) and item.span.holds(old.span):
            return index
    return Rejected(
        sentence=f"`{old.full_name}` is not defined in `{place.tree.span.path}` but at {old.span}",
        help="replace it there by hand, or move it into this config",
    )


def _has_blocks(stack: Stack) -> bool:
    """Whether a config has device blocks, in this text or in its includes."""
    trees = (parse_source(source).tree for source in {node.span.source for node in stack.nodes})
    return any(isinstance(tree, TreeMap) and devices_of(tree) for tree in trees)


def insert_node(place: InsertionPoint, node: Mapping[str, object]) -> tuple[Edit, ...] | Rejected:
    """Insert the node as the last one of its section."""
    return _Inserter(place, node).insert()


def replace_node(
    place: InsertionPoint, index: int, node: Mapping[str, object]
) -> tuple[Edit, ...] | Rejected:
    """Replace the section's node with this index."""
    return _Inserter(place, node).replace(index)


def snippet_of(place: InsertionPoint, node: Mapping[str, object]) -> str:
    """The node as a list item of its section, for the user to paste."""
    return "\n".join(_list_lines(node, place.style, 0))


class _Inserter:
    def __init__(self, place: InsertionPoint, node: Mapping[str, object]) -> None:
        self._place = place
        self._node = node
        self._style = place.style
        self._source = place.tree.span.source
        self._offsets = Offsets.of(self._source)
        self._regions = _Regions(self._source, place.tree)

    def insert(self) -> tuple[Edit, ...] | Rejected:
        place, entry = self._place, self._place.entry
        if is_flow(place.holder):
            key = place.device.key_span if place.device else place.tree.span
            return self._rejected(f"the mapping of the sections ({key}) is in braces")
        if entry is None:
            return tuple(self._new_section())
        reason = self._reason_to_reject(entry)
        if reason is not None:
            return self._rejected(f"section `{entry.key}` ({entry.key_span}) {reason}")
        match entry.value:
            case TreeList() as items:
                edits = self._into_list(entry, items)
            case TreeMap():
                edits = self._into_mapping(entry)
            case TreeScalar() as scalar:
                edits = self._instead_of_value(entry, scalar)
        return tuple(edits)

    def replace(self, index: int) -> tuple[Edit, ...] | Rejected:
        entry = self._place.entry
        assert entry is not None  # it contains the node
        items = entry.value.items if isinstance(entry.value, TreeList) else (entry.value,)
        old, at = items[index], self._offsets
        assert isinstance(old, TreeMap)  # a node is a mapping
        start = at.start(old.span)
        if is_flow(old):
            return self._rejected(f"the node to replace ({old.span}) is in braces")
        indent = indent_of(self._source.line(old.span.line))
        limit = self._regions.limit_of(entry)
        if index + 1 < len(items):
            limit = min(limit, items[index + 1].span.line)
        last = self._regions.last_line(old.span.line, limit, indent)
        margin = " " * (old.span.column - 1)
        lines = f"{self._style.line_end}{margin}".join(_block_lines(self._node, self._style))
        return (at.edit(start, at.at(last, len(self._source.line(last)) + 1), lines),)

    def _rejected(self, reason: str) -> Rejected:
        return Rejected(
            sentence=f"{reason}, and obk edits only block style without anchors",
            help=f"write section `{self._place.section}` as a block list, one key on each line, "
            "then add the node, or paste it there yourself",
        )

    def _reason_to_reject(self, entry: Entry) -> str | None:
        """Why an existing section cannot be edited."""
        value, at = entry.value, self._offsets
        if not self._is_here(entry):
            return f"is an alias of {value.span}"
        if self._colon(entry) is None:
            return "has no colon after its key"
        if isinstance(value, TreeList) and is_flow(value) and value.items:
            return "is a list in brackets"
        if isinstance(value, TreeMap) and is_flow(value):
            return "is a node in braces"
        line = self._source.line(entry.key_span.line)
        start = at.end(entry.key_span) - at.at(entry.key_span.line) + 1
        if isinstance(value, TreeMap) and _ANCHOR.match(line, start):
            return "is a node with an anchor"
        return None

    def _is_here(self, entry: Entry) -> bool:
        """Whether key and value are written in the holder itself, the value after the key."""
        key, value = entry.key_span, entry.value.span
        is_behind = (value.line, value.column) >= (key.end_line, key.end_column)
        return self._place.holder.span.holds(key) and is_behind

    def _colon(self, entry: Entry) -> int | None:
        """The offset after the colon of a key; None for a key written with `?`."""
        colon = _COLON.match(self._source.text, self._offsets.end(entry.key_span))
        return colon.end() if colon else None

    def _into_list(self, entry: Entry, items: TreeList) -> Iterator[Edit]:
        if is_flow(items):
            yield from self._instead_of_value(entry, items)
            return
        last = self._regions.last_line_of(entry)
        dashes = self._dashes(entry.key_span.line + 1, last)
        indent = indent_of(self._source.line(dashes[0]))
        blank = len(dashes) > 1 and self._is_blank_above(dashes[-1])
        yield self._below(last, [*[""] * blank, *self._item(indent)])

    def _dashes(self, first: int, last: int) -> list[int]:
        """The lines on which the items of a block list start."""
        matching = [n for n in range(first, last + 1) if _DASH.match(self._source.line(n))]
        indent = min((indent_of(self._source.line(n)) for n in matching), default=0)
        return [n for n in matching if indent_of(self._source.line(n)) == indent]

    def _item(self, indent: int) -> list[str]:
        return _list_lines(self._node, self._style, indent)

    def _into_mapping(self, entry: Entry) -> Iterator[Edit]:
        """Turn a single node into the first item of a list, keeping its lines if possible."""
        at = self._offsets
        header, last = entry.key_span.line, self._regions.last_line_of(entry)
        first = next(n for n in range(header + 1, last + 1) if self._has_content(n))
        column = indent_of(self._source.line(first))
        is_roomy = column - 2 >= entry.key_span.column - 1
        dash = column - 2 if is_roomy else column
        if is_roomy:
            yield at.edit(at.at(first, dash + 1), at.at(first, column + 1), "- ")
        for number in () if is_roomy else range(first, last + 1):
            if not _is_blank(self._source.line(number)):
                is_first = number == first
                start = at.at(number, dash + 1 if is_first else 1)
                yield at.insert(start, "- " if is_first else "  ")
        yield self._below(last, self._item(dash))

    def _instead_of_value(self, entry: Entry, value: TreeScalar | TreeList) -> Iterator[Edit]:
        """Write a block list below a key whose value was `[]`, `null` or empty."""
        at = self._offsets
        colon = self._colon(entry) or 0
        if at.end(value.span) > at.start(value.span):
            yield at.edit(colon, at.end(value.span))
        column = entry.key_span.column - 1
        last = self._regions.last_line_of(entry)
        yield self._below(last, self._item(column + self._style.section_dash))

    def _new_section(self) -> Iterator[Edit]:
        place = self._place
        own = _own_sections(place.holder)
        if place.new_device or not own:
            first = place.tree.entries[0].key_span.column - 1
            yield self._below(self._last_line_of_text(), self._section_lines(first))
            return
        rank = _SECTION_ORDER.index(place.section)
        before = [e for e in own if _SECTION_ORDER.index(e.key) < rank]
        lines = self._section_lines(own[0].key_span.column - 1)
        is_spaced = any(self._is_blank_above(e.key_span.line) for e in own[1:])
        if before:
            above = max(before, key=lambda e: _SECTION_ORDER.index(e.key))
            yield self._below(self._regions.last_line_of(above), [*[""] * is_spaced, *lines])
            return
        yield self._above(own[0], [*lines, *[""] * is_spaced])

    def _section_lines(self, column: int) -> list[str]:
        place, step = self._place, self._style.step
        lines = []
        if place.new_device:
            lines.append(f"{' ' * column}{place.new_device}:")
            column += step
        lines.append(f"{' ' * column}{place.section}:")
        return [*lines, *self._item(column + self._style.section_dash)]

    def _above(self, entry: Entry, lines: list[str]) -> Edit:
        """Insert lines above a key and its comments, but below a comment that heads the file."""
        number = entry.key_span.line
        while number > 1 and _is_comment(self._source.line(number - 1)):
            number -= 1
        if number == 1:
            number = entry.key_span.line
        end = self._style.line_end
        return self._offsets.insert(
            self._offsets.at(number), "".join(f"{line}{end}" for line in lines)
        )

    def _below(self, number: int, lines: list[str]) -> Edit:
        """Insert lines below a line; a file without a final line end stays that way."""
        at, end = self._offsets.at(number + 1), self._style.line_end
        if number < len(self._source.lines):
            return self._offsets.insert(at, "".join(f"{line}{end}" for line in lines))
        return self._offsets.insert(at, "".join(f"{end}{line}" for line in lines))

    def _last_line_of_text(self) -> int:
        last = self._regions.end - 1
        while last > 1 and _is_blank(self._source.line(last)):
            last -= 1
        return last

    def _has_content(self, number: int) -> bool:
        line = self._source.line(number)
        return not _is_blank(line) and not _is_comment(line)

    def _is_blank_above(self, number: int) -> bool:
        """Whether a blank line precedes a line and the comments directly above it."""
        while number > 1 and _is_comment(self._source.line(number - 1)):
            number -= 1
        return number > 1 and _is_blank(self._source.line(number - 1))


def named_as(style: Style, entry: Mapping[str, object]) -> dict[str, object]:
    """The entry with its components named by `key` or `ros_parameter`, depending on the style."""
    return {
        key: [_renamed(item, style) for item in value]
        if key in COMPONENT_LISTS and isinstance(value, list)
        else value
        for key, value in entry.items()
    }


def _list_lines(entry: Mapping[str, object], style: Style, indent: int) -> list[str]:
    """The entry as a list item in block style, with its dash at `indent`."""
    first, *rest = _block_lines(entry, style)
    margin, body = " " * indent, " " * (1 + style.gap)
    return [f"{margin}-{' ' * style.gap}{first}", *(f"{margin}{body}{line}" for line in rest)]


def _block_lines(entry: Mapping[str, object], style: Style) -> list[str]:
    """The entry as a block mapping at the left margin."""
    return list(_block(entry, style))


def inline_text(value: object) -> str:
    """A value on one line, as in flow style."""
    if isinstance(value, Mapping):
        inside = (f"{key}: {inline_text(item)}" for key, item in value.items())
        return f"{{{', '.join(inside)}}}"
    if isinstance(value, list):
        return f"[{', '.join(inline_text(item) for item in value)}]"
    return _scalar(value)


def _renamed(component: Mapping[str, object], style: Style) -> dict[str, object]:
    identity = identity_of(component)
    name = identity if style.naming == "key" else f"{identity}{SETTING_SUFFIX}"
    rest = {k: v for k, v in component.items() if k not in ("ros_parameter", "key")}
    return {style.naming: name, **rest}


def _block(mapping: Mapping[str, object], style: Style) -> Iterator[str]:
    for key, value in mapping.items():
        if isinstance(value, Mapping) and value:
            yield f"{key}:"
            yield from (f"{' ' * style.step}{line}" for line in _block(value, style))
        elif isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
            yield f"{key}:"
            for item in value:
                yield from _item(item, style)
        else:
            yield f"{key}: {inline_text(value)}"


def _item(item: object, style: Style) -> Iterator[str]:
    if isinstance(item, Mapping):
        yield from _list_lines(item, style, style.dash)
    else:
        yield f"{' ' * style.dash}-{' ' * style.gap}{inline_text(item)}"


def _scalar(value: object) -> str:
    match value:
        case None:
            return "null"
        case bool():
            return "true" if value else "false"
        case float() if "e" in repr(value):
            return f"{Decimal(repr(value)):f}"
        case int() | float():
            return repr(value)
    text = str(value)
    is_plain = _PLAIN.fullmatch(text) is not None and core_scalar(text) == text
    return text if is_plain else json.dumps(text, ensure_ascii=False)


@dataclass(frozen=True, slots=True)
class _Regions:
    """The regions of source text, in lines from 1."""

    source: SourceFile
    tree: TreeMap

    def limit_of(self, entry: Entry) -> int:
        """The first line after the entry: that of the next key, or past the end."""
        line, column = entry.key_span.line, entry.key_span.column
        later = (s.line for s in _keys(self.tree) if s.line > line and s.column <= column)
        return min(later, default=self.end)

    def last_line_of(self, entry: Entry) -> int:
        """The last line of an entry, including comments indented more than its key."""
        first = entry.key_span.line
        return self.last_line(first, self.limit_of(entry), entry.key_span.column - 1)

    def last_line(self, first: int, limit: int, indent: int) -> int:
        """The last line from `first` on with content or a comment indented more than `indent`."""
        last = first
        for number in range(first + 1, limit):
            line = self.source.line(number)
            if not _is_blank(line) and (not _is_comment(line) or indent_of(line) > indent):
                last = number
        return last

    @property
    def end(self) -> int:
        """The line after the document: an end marker, or past the text."""
        marked = (
            number
            for number in range(self.tree.span.line, len(self.source.lines) + 1)
            if self.source.line(number).startswith(("...", "---"))
        )
        return next(marked, len(self.source.lines) + 1)


def _is_blank(line: str) -> bool:
    """Whether a line is empty."""
    return not line.strip()


def _is_comment(line: str) -> bool:
    """Whether a line contains only a comment."""
    return line.lstrip().startswith("#")


def _keys(tree: Tree) -> Iterator[Span]:
    """The keys of all block mappings."""
    if isinstance(tree, TreeMap) and not is_flow(tree):
        for entry in tree:
            yield entry.key_span
            yield from _keys(entry.value)
    elif isinstance(tree, TreeList) and not is_flow(tree):
        for item in tree.items:
            yield from _keys(item)


def _own_sections(holder: TreeMap) -> list[Entry]:
    """The sections written in the mapping itself, in text order."""
    own = (e for e in holder if e.key in _SECTION_ORDER and holder.span.holds(e.key_span))
    return sorted(own, key=lambda entry: (entry.key_span.line, entry.key_span.column))
