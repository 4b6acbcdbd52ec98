"""The edits that put a node into a section, or in the place of another one.

A text with its tree and the entry in; edits out, or why there is no certain place. Nothing that is
there is written anew but the node that is replaced.
"""

import re
from collections.abc import Iterator, Mapping

from obk_cli.config.fixes import is_flow
from obk_cli.config.tree import Entry, TreeList, TreeMap, TreeScalar
from obk_cli.diagnostics.edits import Edit, Offsets
from obk_cli.diagnostics.source import indent_of
from obk_cli.joining.brackets import (
    SECTION_ORDER,
    append_in_brackets,
    own_sections,
    section_in_braces,
)
from obk_cli.joining.entry_text import block_lines, flow_text, list_lines
from obk_cli.joining.place import Place
from obk_cli.joining.refusal import Refused
from obk_cli.joining.region import Regions, is_blank, is_comment
from obk_cli.joining.style import is_flow_list

__all__ = ["insert_node", "replace_node"]

_DASH = re.compile(r" *-(?= |$)")
_ANCHOR = re.compile(r"[ \t]*(&[^\s,\[\]{}]+)")
_COLON = re.compile(r"[ \t]*:")


def insert_node(place: Place, node: Mapping[str, object]) -> tuple[Edit, ...] | Refused:
    """The node as the last one of its section."""
    return _Inserter(place, node).insert()


def replace_node(place: Place, index: int, node: Mapping[str, object]) -> tuple[Edit, ...]:
    """The node where the section's node of that index stands now."""
    return tuple(_Inserter(place, node).replace(index))


class _Inserter:
    def __init__(self, place: Place, node: Mapping[str, object]) -> None:
        self._place = place
        self._node = node
        self._style = place.style
        self._source = place.tree.span.source
        self._offsets = Offsets.of(self._source)
        self._regions = Regions(self._source, place.tree)

    def insert(self) -> tuple[Edit, ...] | Refused:
        entry = self._place.entry
        if entry is None:
            return tuple(self._new_section())
        if not self._is_here(entry):
            return Refused(
                sentence=f"section `{entry.key}` stands here by an anchor, written at "
                f"{entry.value.span}",
                help="write the section out where it is meant, then add the node",
            )
        if self._colon(entry) is None:
            return Refused(
                sentence=f"key `{entry.key}` ({entry.key_span}) has no colon behind it",
                help=f"write `{entry.key}:` on a line of its own, then add the node",
            )
        match entry.value:
            case TreeList() as items:
                edits = self._into_list(entry, items)
            case TreeMap() as mapping:
                edits = self._into_mapping(entry, mapping)
            case TreeScalar() as scalar:
                edits = self._into_nothing(entry, scalar)
        return tuple(edits)

    def replace(self, index: int) -> Iterator[Edit]:
        entry = self._place.entry
        assert entry is not None  # it holds the node
        items = entry.value.items if isinstance(entry.value, TreeList) else (entry.value,)
        old, at = items[index], self._offsets
        assert isinstance(old, TreeMap)  # a node is one
        start = at.start(old.span)
        if is_flow(old):
            yield at.edit(start, at.end(old.span), flow_text(self._node))
            return
        indent = indent_of(self._source.line(old.span.line))
        limit = self._regions.limit_of(entry)
        if index + 1 < len(items):
            limit = min(limit, items[index + 1].span.line)
        last = self._regions.last_line(old.span.line, limit, indent)
        margin = " " * (old.span.column - 1)
        lines = f"{self._style.line_end}{margin}".join(block_lines(self._node, self._style))
        yield at.edit(start, at.at(last, len(self._source.line(last)) + 1), lines)

    def _is_here(self, entry: Entry) -> bool:
        """Whether key and value stand in the holder itself, the value behind the key."""
        key, value = entry.key_span, entry.value.span
        is_behind = (value.line, value.column) >= (key.end_line, key.end_column)
        return self._place.holder.span.holds(key) and is_behind

    def _colon(self, entry: Entry) -> int | None:
        """The offset behind the colon of a key, None for a key that is written with `?`."""
        colon = _COLON.match(self._source.text, self._offsets.end(entry.key_span))
        return colon.end() if colon else None

    def _into_list(self, entry: Entry, items: TreeList) -> Iterator[Edit]:
        if is_flow_list(items):
            if items.items or is_flow(self._place.holder):
                yield from append_in_brackets(items, flow_text(self._node), self._style.line_end)
            else:
                yield from self._instead_of_value(entry, items)
            return
        last = self._regions.last_line_of(entry)
        dashes = self._dashes(entry.key_span.line + 1, last)
        indent = indent_of(self._source.line(dashes[0]))
        blank = len(dashes) > 1 and self._is_blank_above(dashes[-1])
        yield self._below(last, [*[""] * blank, *self._item(indent, items)])

    def _dashes(self, first: int, last: int) -> list[int]:
        """The lines on which the items of a block list start."""
        matching = [n for n in range(first, last + 1) if _DASH.match(self._source.line(n))]
        indent = min((indent_of(self._source.line(n)) for n in matching), default=0)
        return [n for n in matching if indent_of(self._source.line(n)) == indent]

    def _item(self, indent: int, items: TreeList | None = None) -> list[str]:
        """The lines of the new item; in braces where all the others are."""
        others = [item for item in items.items if isinstance(item, TreeMap)] if items else []
        if others and all(is_flow(item) for item in others):
            return [f"{' ' * indent}-{' ' * self._style.gap}{flow_text(self._node)}"]
        return list_lines(self._node, self._style, indent)

    def _into_mapping(self, entry: Entry, mapping: TreeMap) -> Iterator[Edit]:
        """The one node becomes the first of a list; its lines stay where they are if they can."""
        at = self._offsets
        if is_flow(mapping):
            yield at.insert(at.start(mapping.span), "[")
            yield at.insert(at.end(mapping.span), f", {flow_text(self._node)}]")
            return
        header, last = entry.key_span.line, self._regions.last_line_of(entry)
        content = (n for n in range(header + 1, last + 1) if self._has_content(n))
        first = next(content)
        column = indent_of(self._source.line(first))
        is_roomy = column - 2 >= entry.key_span.column - 1
        dash = column - 2 if is_roomy else column
        anchor = _ANCHOR.match(
            self._source.line(header), at.end(entry.key_span) - at.at(header) + 1
        )
        if anchor:
            yield at.edit(at.at(header, anchor.start() + 1), at.at(header, anchor.end() + 1))
            end = self._style.line_end
            yield at.insert(at.at(first), f"{' ' * dash}- {anchor[1]}{end}")
        elif is_roomy:
            yield at.edit(at.at(first, dash + 1), at.at(first, column + 1), "- ")
        if not is_roomy:
            for number in range(first, last + 1):
                if not is_blank(self._source.line(number)):
                    is_first = number == first and not anchor
                    start = at.at(number, dash + 1 if is_first else 1)
                    yield at.insert(start, "- " if is_first else "  ")
        yield self._below(last, self._item(dash))

    def _into_nothing(self, entry: Entry, value: TreeScalar) -> Iterator[Edit]:
        if is_flow(self._place.holder):
            text = f"[{flow_text(self._node)}]"
            colon = self._colon(entry) or 0
            end = max(self._offsets.end(value.span), colon)
            yield self._offsets.edit(colon, end, f" {text}")
        else:
            yield from self._instead_of_value(entry, value)

    def _instead_of_value(self, entry: Entry, value: TreeScalar | TreeList) -> Iterator[Edit]:
        """A block list below a key that had `[]`, `null` or nothing."""
        at = self._offsets
        colon = self._colon(entry) or 0
        if at.end(value.span) > at.start(value.span):
            yield at.edit(colon, at.end(value.span))
        column = entry.key_span.column - 1
        last = self._regions.last_line_of(entry)
        yield self._below(last, self._item(column + self._style.section_dash))

    def _new_section(self) -> Iterator[Edit]:
        place = self._place
        own = own_sections(place.holder)
        if is_flow(place.holder):
            yield from section_in_braces(place, flow_text(self._node))
            return
        if place.new_device or not own:
            first = place.tree.entries[0].key_span.column - 1
            yield self._below(self._last_line_of_text(), self._section_lines(first))
            return
        rank = SECTION_ORDER.index(place.section)
        before = [e for e in own if SECTION_ORDER.index(e.key) < rank]
        lines = self._section_lines(own[0].key_span.column - 1)
        is_spaced = any(self._is_blank_above(e.key_span.line) for e in own[1:])
        if before:
            above = max(before, key=lambda e: SECTION_ORDER.index(e.key))
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
        """Lines above a key and the comments right above it, not above the head of the file."""
        number = entry.key_span.line
        while number > 1 and is_comment(self._source.line(number - 1)):
            number -= 1
        if number == 1:
            number = entry.key_span.line
        end = self._style.line_end
        return self._offsets.insert(
            self._offsets.at(number), "".join(f"{line}{end}" for line in lines)
        )

    def _below(self, number: int, lines: list[str]) -> Edit:
        """Lines below a line; a last line without an end stays the one without."""
        at, end = self._offsets.at(number + 1), self._style.line_end
        if number < len(self._source.lines):
            return self._offsets.insert(at, "".join(f"{line}{end}" for line in lines))
        return self._offsets.insert(at, "".join(f"{end}{line}" for line in lines))

    def _last_line_of_text(self) -> int:
        last = self._regions.end - 1
        while last > 1 and is_blank(self._source.line(last)):
            last -= 1
        return last

    def _has_content(self, number: int) -> bool:
        line = self._source.line(number)
        return not is_blank(line) and not is_comment(line)

    def _is_blank_above(self, number: int) -> bool:
        """Whether a blank line stands above a line and the comments right above it."""
        while number > 1 and is_comment(self._source.line(number - 1)):
            number -= 1
        return number > 1 and is_blank(self._source.line(number - 1))
