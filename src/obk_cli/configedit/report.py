"""Report the result of adding a node to a config, as lines of text and as plain values.

Pure.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from obelisk_spec.suggestions import list_names
from obk_cli.config.model import Node, Stack
from obk_cli.config.topology import stack_endpoints
from obk_cli.config.tree import TreeMap
from obk_cli.configedit.auto_wiring import Link, Tick
from obk_cli.configedit.block_editor import InsertionPoint
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.edits import Edit, Offsets
from obk_cli.diagnostics.source import SourceFile, Span

__all__ = ["AddedNode", "added_lines", "added_values", "lost_publishers", "moved", "notes_of"]


@dataclass(frozen=True, slots=True, kw_only=True)
class AddedNode:
    """A config with a new or replaced node."""

    source: SourceFile
    """The old text."""
    text: str
    node_name: str
    """The node's full name in the ROS graph."""
    links: tuple[Link, ...]
    ticks: tuple[Tick, ...]
    notes: tuple[str, ...]
    """Other changes and remarks, as sentences."""
    unpublished: Mapping[str, tuple[str, ...]]
    """Topics that only the replaced node published -> their subscribers."""
    before: tuple[Diagnostic, ...]
    """The findings of the old config."""


def added_lines(added: AddedNode, *, is_done: bool = True) -> tuple[str, ...]:
    """The node, one line for each of its ends and timers, and notes."""
    verb = "added to" if is_done else "would be added to"
    width = max((len(name) for name in _names(added)), default=0)
    lines = [f"`{added.node_name}` {verb} {added.source.path}:"]
    for link in added.links:
        arrow = "->" if link.end.direction == "publishes" else "<-"
        end = f"{link.written} ({link.end.spelling}){_peers(link)}"
        lines.append(f"  {link.end.component:<{width}} {arrow} {end}")
        lines += [f"  {'':<{width}}    {note}" for note in _link_notes(link)]
    for tick in added.ticks:
        period = f"every {tick.period_s:g} s, {tick.origin}"
        lines.append(f"  {tick.component:<{width}} {period}")
    return (*lines, *(f"note: {note}" for note in _all_notes(added)))


def added_values(added: AddedNode) -> dict[str, object]:
    """The same as plain values."""
    return {
        "config": added.source.path,
        "node": added.node_name,
        "links": [
            {
                "component": link.end.component,
                "direction": link.end.direction,
                "topic": link.topic,
                "msg_type": link.end.msg_type,
                "with": list(link.peers),
                "notes": list(_link_notes(link)),
            }
            for link in added.links
        ],
        "timers": [
            {"component": tick.component, "period_s": tick.period_s, "from": tick.origin}
            for tick in added.ticks
        ],
        "notes": list(_all_notes(added)),
    }


def lost_publishers(before: Stack, after: Stack) -> dict[str, tuple[str, ...]]:
    """Topics with a publisher before but none after the change -> their subscribers."""
    ends = tuple(stack_endpoints(after))
    published = {end.topic for end in ends if end.direction == "publishes"}
    lost = {e.topic for e in stack_endpoints(before) if e.direction == "publishes"} - published
    return {
        topic: readers
        for topic in sorted(lost)
        if (readers := tuple(dict.fromkeys(end.owner for end in ends if end.topic == topic)))
    }


def _all_notes(added: AddedNode) -> Iterator[str]:
    yield from added.notes
    for topic, readers in added.unpublished.items():
        verb = "subscribes" if len(readers) == 1 else "subscribe"
        yield f"nothing publishes `{topic}` any more, to which {list_names(readers)} {verb}"


def _names(added: AddedNode) -> Iterator[str]:
    yield from (link.end.component for link in added.links)
    yield from (tick.component for tick in added.ticks)


def _peers(link: Link) -> str:
    if not link.peers:
        return ""
    verb = "to" if link.end.direction == "publishes" else "from"
    return f" {verb} {', '.join(f'`{peer}`' for peer in link.peers)}"


def _link_notes(link: Link) -> Iterator[str]:
    yield from link.notes
    if link.switch is not None:
        yield (
            f"to switch over, use it as the topic of `{link.switch.reader}` at "
            f"{link.switch.place}, or let the new node replace `{link.switch.writer}`"
        )


def notes_of(
    place: InsertionPoint,
    edits: Iterable[Edit],
    before: Stack,
    after: Stack,
    node: Node,
    old: Node | None,
) -> tuple[str, ...]:
    """Sentences about the changes between `before` and `after`, which has the new `node`."""
    return tuple(_notes(place, edits, before, after, node, old))


def moved(link: Link, source: SourceFile, edits: Iterable[Edit]) -> Link:
    """The link, with the location of its `switch` adjusted to the new text."""
    if link.switch is None or link.switch.place.path != source.path:
        return link
    old = link.switch.place
    shift = sum(
        len(SourceFile.of("", edit.text).lines) - 1 - (edit.span.end_line - edit.span.line)
        for edit in edits
        if edit.span.end_line <= old.line
    )
    place = Span.at(source, old.line + shift, old.column, old.end_column - old.column)
    return replace(link, switch=replace(link.switch, place=place))


def _notes(
    place: InsertionPoint,
    edits: Iterable[Edit],
    before: Stack,
    after: Stack,
    node: Node,
    old: Node | None,
) -> Iterator[str]:
    source = place.tree.span.source
    if old is not None:
        yield f"it replaces `{old.full_name}`{_comments_within(source, edits)}"
    section = place.section
    others = {n.span.path: n for n in before.section(section) if n.span.path != source.path}
    for path, other in others.items():
        yield (
            f"`{section}` also has nodes in {path} (line {other.span.line}); the new one is "
            f"added to {source.path}"
        )
    if place.entry is None and not others:
        yield f"section `{section}` is new"
    elif old is None and place.entry and isinstance(place.entry.value, TreeMap):
        yield f"section `{section}` was a single node and is now a list"
    kept = [n for n in after.section(section) if n is not node]
    for one, now in zip((n for n in before.section(section) if n is not old), kept, strict=True):
        if one.full_name != now.full_name:
            yield (
                f"`{one.full_name}` on {one.device} is now `{now.full_name}`: nodes without a "
                "`name` are numbered"
            )


def _comments_within(source: SourceFile, edits: Iterable[Edit]) -> str:
    """The note about comments that are removed together with the lines of a node."""
    offsets = Offsets.of(source)
    removed = (source.text[offsets.start(e.span) : offsets.end(e.span)] for e in edits)
    count = sum(len(re.findall(r"(?:^|\s)#", text)) for text in removed)
    if not count:
        return ""
    return f", and {count} comment{'s were' if count > 1 else ' was'} removed with its lines"
