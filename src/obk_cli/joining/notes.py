"""What has changed in a config beyond the new node's own lines, as sentences.

The edits and the stack before and after in; sentences, and places as they are now, out.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace

from obk_cli.config.model import Node, Stack
from obk_cli.config.tree import TreeMap
from obk_cli.diagnostics.edits import Edit, Offsets
from obk_cli.diagnostics.source import SourceFile, Span
from obk_cli.joining.choose import Link
from obk_cli.joining.place import Place

__all__ = ["moved", "notes_of"]


def notes_of(
    place: Place,
    edits: Iterable[Edit],
    before: Stack,
    after: Stack,
    node: Node,
    old: Node | None,
) -> tuple[str, ...]:
    """The sentences about `node`, which `after` has and `before` has not."""
    return tuple(_notes(place, edits, before, after, node, old))


def moved(link: Link, source: SourceFile, edits: Iterable[Edit]) -> Link:
    """The link, the place to switch over as it is in the new text."""
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
    place: Place,
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
            f"`{section}` has nodes in {path} too (line {other.span.line}); the new one is "
            f"added to {source.path}"
        )
    if place.entry is None and not others:
        yield f"section `{section}` is new"
    elif old is None and place.entry and isinstance(place.entry.value, TreeMap):
        yield f"section `{section}` was one node and is a list now"
    kept = [n for n in after.section(section) if n is not node]
    for one, now in zip((n for n in before.section(section) if n is not old), kept, strict=True):
        if one.full_name != now.full_name:
            yield (
                f"`{one.full_name}` on {one.device} is `{now.full_name}` now: nodes without a "
                "`name` are counted"
            )


def _comments_within(source: SourceFile, edits: Iterable[Edit]) -> str:
    """What is said of comments that go with the lines of a node."""
    offsets = Offsets.of(source)
    gone = (source.text[offsets.start(e.span) : offsets.end(e.span)] for e in edits)
    count = sum(len(re.findall(r"(?:^|\s)#", text)) for text in gone)
    if not count:
        return ""
    return f", whose lines had {count} comment{'s that are' if count > 1 else ' that is'} gone too"
