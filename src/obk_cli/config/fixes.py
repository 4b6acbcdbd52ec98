"""Safe fixes as edits: replace a word, or remove a key from a mapping.

There is no edit if the user's text does not literally contain the value to change, because it comes
from an alias, a variable or an escape.
"""

import json
import re

from obelisk_spec.yaml_core import core_scalar
from obk_cli.config.tree import Entry, TreeList, TreeMap, TreeScalar
from obk_cli.diagnostics.edits import Edit
from obk_cli.diagnostics.source import Span

__all__ = ["append_to", "is_flow", "remove_entry", "respell"]

_FLOW = re.compile(r"(?:[&!]\S*\s+)*[{\[]")
_BLANK_OR_COMMENT = re.compile(r"[ \t]*(#.*)?")
_COMMA_AFTER = re.compile(r"[ \t]*,[ \t]*")
_COMMA_BEFORE = re.compile(r",[ \t]*$")
_SAFE_PLAIN = re.compile(r"[A-Za-z_/][A-Za-z0-9_./-]*")


def respell(span: Span, old: str, new: str) -> tuple[Edit, ...]:
    """The edit that replaces `old` with `new`, in the same quotes."""
    written = _written(span)
    quote = written[:1] if written[:1] in ("'", '"') else ""
    if not old or written != f"{quote}{old}{quote}":
        return ()
    is_safe = _SAFE_PLAIN.fullmatch(new) is not None
    if quote:
        return (Edit(span, f"{quote}{new}{quote}" if is_safe else json.dumps(new)),)
    return (Edit(span, new if is_safe and core_scalar(new) == new else json.dumps(new)),)


def append_to(span: Span, written: str, end: str) -> tuple[Edit, ...]:
    """The edit that appends `end` to the unquoted text `written`."""
    return (Edit(span, f"{written}{end}"),) if _written(span) == written else ()


def _written(span: Span) -> str:
    """The text of a one-line span."""
    return span.text if span.end_line == span.line else ""


def is_flow(collection: TreeMap | TreeList) -> bool:
    """Whether a mapping is written in braces, or a list in brackets."""
    span = collection.span
    return _FLOW.match(span.source.line(span.line), span.column - 1) is not None


def remove_entry(mapping: TreeMap, entry: Entry) -> tuple[Edit, ...]:
    """The edit that removes a key with its one-line value; a comment after it is kept."""
    key, value = entry.key_span, entry.value.span
    line = key.source.line(key.line)
    between = line[key.end_column - 1 : value.column - 1]
    is_own = key.line == value.line == value.end_line and mapping.span.holds(key)
    if not isinstance(entry.value, TreeScalar) or not is_own:
        return ()
    if re.fullmatch(r"[ \t]*:[ \t]*", between) is None:
        return ()
    place = Span(key.source, key.line, key.column, key.line, value.end_column)
    return (_from_flow(place),) if is_flow(mapping) else _from_block(mapping, place)


def _from_flow(place: Span) -> Edit:
    """With the comma after it; for the last entry, the comma before it."""
    line = place.source.line(place.line)
    after = _COMMA_AFTER.match(line, place.end_column - 1)
    before = None if after else _COMMA_BEFORE.search(line, 0, place.column - 1)
    column = before.start() + 1 if before else place.column
    end_column = after.end() + 1 if after else place.end_column
    return Edit(Span(place.source, place.line, column, place.line, end_column), "")


def _from_block(mapping: TreeMap, place: Span) -> tuple[Edit, ...]:
    source, number = place.source, place.line
    line = source.line(number)
    rest = _BLANK_OR_COMMENT.fullmatch(line, place.end_column - 1)
    if rest is None:
        return ()
    if rest[1]:
        return (Edit(Span(source, number, place.column, number, rest.start(1) + 1), ""),)
    if not line[: place.column - 1].strip():
        return (Edit(Span(source, number, 1, number + 1, 1), ""),)
    later = (other.key_span for other in mapping if mapping.span.holds(other.key_span))
    following = min((s for s in later if s.line > number), key=lambda s: s.line, default=None)
    if following is None or any(source.line(n).strip() for n in range(number + 1, following.line)):
        return ()
    return (Edit(Span(source, number, place.column, following.line, following.column), ""),)
