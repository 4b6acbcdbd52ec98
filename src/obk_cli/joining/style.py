"""How a config is laid out, so that what is put into it looks like the rest.

A tree in; indents, the naming of components and the use of braces out, those of the section itself
before those of other sections, the usual ones where there is nothing to go by.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from obk_cli.config.fixes import is_flow
from obk_cli.config.model import COMPONENT_LISTS, NODE_SECTIONS
from obk_cli.config.tree import Entry, Tree, TreeList, TreeMap
from obk_cli.diagnostics.source import SourceFile, line_end_of
from obk_cli.migrate.shape import devices_of, sections_of

__all__ = ["Style", "is_flow_list", "style_of"]

_FLOW_LIST = re.compile(r"(?:[&!]\S*\s+)*\[")


@dataclass(frozen=True, slots=True, kw_only=True)
class Style:
    """The layout of a text; widths in columns."""

    line_end: str = "\n"
    step: int = 2
    """From a key to the keys of the mapping below it."""
    section_dash: int = 2
    """From a section to the dashes of its nodes."""
    dash: int = 2
    """From a key within a node to the dashes of its list."""
    gap: int = 1
    """Spaces behind a dash."""
    naming: Literal["ros_parameter", "key"] = "key"
    flow_components: bool = False
    """Whether components are in braces."""


def style_of(source: SourceFile, tree: TreeMap, section: str) -> Style:
    """The layout of a text, as its nodes of `section` have it if there are any."""
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
        flow_components=bool(components) and is_flow(components[0]),
    )


def is_flow_list(items: TreeList) -> bool:
    """Whether a list is written in brackets."""
    span = items.span
    return _FLOW_LIST.match(span.source.line(span.line), span.column - 1) is not None


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
        if isinstance(value, TreeList) and not is_flow_list(value):
            width = value.span.column - entry.key_span.column
            if value.span.line > entry.key_span.line and width >= 0:
                yield width


def _gaps(entries: tuple[Entry, ...]) -> Iterator[int]:
    for entry in entries:
        if isinstance(entry.value, TreeList) and not is_flow_list(entry.value):
            for item in _maps(entry.value):
                line = item.span.source.line(item.span.line)
                behind = re.match(r" *-( +)", line)
                if behind is not None and behind.end() == item.span.column - 1:
                    yield len(behind[1])


def _uses_parameters(components: list[TreeMap]) -> bool:
    named = [c for c in components if c.get("ros_parameter") or c.get("key")]
    return bool(named) and named[0].get("ros_parameter") is not None
