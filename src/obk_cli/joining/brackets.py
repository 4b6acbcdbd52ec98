"""Edits within braces and brackets: an item more in a list, a section more in a mapping.

Trees with places and the new value's text in; edits out.
"""

import re
from collections.abc import Iterator

from obk_cli.config.tree import Entry, TreeList, TreeMap
from obk_cli.diagnostics.edits import Edit, Offsets
from obk_cli.diagnostics.source import indent_of
from obk_cli.joining.place import Place

__all__ = ["SECTION_ORDER", "append_in_brackets", "own_sections", "section_in_braces"]

SECTION_ORDER = ("control", "estimation", "sensing", "robot", "viz", "joystick")
"""The order in which configs have their sections."""


_COMMA = re.compile(r"[ \t]*,")
_REST_OF_LINE = re.compile(r"[ \t]*(?:#[^\r\n]*)?(?=[\r\n]|$)")


def append_in_brackets(items: TreeList, new: str, line_end: str) -> Iterator[Edit]:
    """A value in front of the closing bracket, on a line of its own where the last item has one."""
    source = items.span.source
    at, text = Offsets.of(source), source.text
    bracket = at.end(items.span) - 1
    last = items.items[-1].span if items.items else None
    if last is None or not items.span.holds(last):
        yield at.insert(bracket, f", {new}" if last else new)
        return
    line, end = source.line(last.line), at.end(last)
    comma = _COMMA.match(text, end)
    behind = comma.end() if comma else end
    rest = _REST_OF_LINE.match(text, behind)
    if line[: last.column - 1].strip() or rest is None:
        yield at.insert(behind if comma else end, f" {new}," if comma else f", {new}")
        return
    below = f"{line_end}{' ' * indent_of(line)}{new}"
    if comma:
        yield at.insert(rest.end(), f"{below},")
    elif rest.end() == end:
        yield at.insert(end, f",{below}")
    else:
        yield at.insert(end, ",")
        yield at.insert(rest.end(), below)


def section_in_braces(place: Place, node: str) -> Iterator[Edit]:
    """A new section, with one node, between those that a mapping in braces has."""
    at = Offsets.of(place.tree.span.source)
    new = f"{place.section}: [{node}]"
    if place.new_device:
        new = f"{place.new_device}: {{{new}}}"
    rank = SECTION_ORDER.index(place.section)
    own = [] if place.new_device else own_sections(place.holder)
    before = [entry for entry in own if SECTION_ORDER.index(entry.key) < rank]
    if own and not before:
        yield at.insert(at.start(own[0].key_span), f"{new}, ")
    else:
        above = before[-1] if before else place.holder.entries[-1]
        yield at.insert(at.end(above.value.span), f", {new}")


def own_sections(holder: TreeMap) -> list[Entry]:
    """The sections that are written in the mapping itself, in the order of the text."""
    own = (e for e in holder if e.key in SECTION_ORDER and holder.span.holds(e.key_span))
    return sorted(own, key=lambda entry: (entry.key_span.line, entry.key_span.column))
