"""The edits that take one key out of a mapping, its comments kept.

A mapping of the user's text and one entry of it in; edits out, none where the entry is more than
a value on one line or where nothing would be left.
"""

import re

from obk_cli.edits import Edit, Offsets
from obk_cli.tree import Entry, TreeMap, TreeScalar

__all__ = ["is_flow", "remove_entry"]

_FLOW = re.compile(r"(?:[&!]\S*\s+)*\{")
_REST = re.compile(r"[ \t]*(?=(#)|[\r\n]|$)")
_COMMA_AFTER = re.compile(r"[ \t]*,[ \t]*")
_COMMA_BEFORE = re.compile(r",\s*$")


def is_flow(mapping: TreeMap, offsets: Offsets) -> bool:
    """Whether a mapping is written in braces."""
    start = offsets.start(mapping.span)
    return _FLOW.match(offsets.source.text, start) is not None


def remove_entry(mapping: TreeMap, entry: Entry, offsets: Offsets) -> tuple[Edit, ...]:
    """The edits that remove `entry`; a comment behind it stays on a line of its own."""
    text = offsets.source.text
    start, value = offsets.start(entry.key_span), entry.value
    end = offsets.end(value.span)
    between = text[offsets.end(entry.key_span) : offsets.start(value.span)]
    is_simple = isinstance(value, TreeScalar) and re.fullmatch(r"[ \t]*:[ \t]*", between)
    if not is_simple or value.span.end_line != entry.key_span.line:
        return ()
    if is_flow(mapping, offsets):
        return _from_flow(start, end, offsets)
    return _from_block(mapping, start, end, offsets)


def _from_flow(start: int, end: int, offsets: Offsets) -> tuple[Edit, ...]:
    text = offsets.source.text
    after = _COMMA_AFTER.match(text, end)
    if after is not None:
        return (offsets.edit(start, after.end()),)
    before = _COMMA_BEFORE.search(text, 0, start)
    return (offsets.edit(before.start() if before else start, end),)


def _from_block(mapping: TreeMap, start: int, end: int, offsets: Offsets) -> tuple[Edit, ...]:
    text = offsets.source.text
    rest = _REST.match(text, end)
    line = offsets.span(start, end).line
    line_start, next_line = offsets.at(line), offsets.at(line + 1)
    if rest is None:
        return ()
    if rest[1]:
        return (offsets.edit(start, rest.end()),)
    if not text[line_start:start].strip():
        return (offsets.edit(line_start, next_line),)
    following = (offsets.start(other.key_span) for other in mapping)
    next_key = min((place for place in following if place > start), default=None)
    if next_key is None or text[end:next_key].strip():
        return ()
    return (offsets.edit(start, next_key),)
