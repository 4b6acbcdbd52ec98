"""Remove the device level from a config with the single device `onboard`, or add it.

Pure: a tree and its text in; edits that move lines sideways out, or what prevents them. Only block
style is edited.
"""

import re
from collections.abc import Iterator

from obk_cli.config.fixes import is_flow
from obk_cli.config.model import ONE_DEVICE
from obk_cli.config.tree import Entry, TreeMap
from obk_cli.configedit.shape import devices_of, sections_of
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.edits import Edit, Offsets
from obk_cli.diagnostics.source import Span, indent_of, line_end_of

__all__ = ["kept", "lift_device", "nest_sections"]

_PLAIN_COLON = re.compile(r"[ \t]*:\s*(?:#[^\r\n]*\s*)*")
_BEHIND_COLON = re.compile(r"[ \t]*:[ \t]*(?=(#)|[\r\n])")
_USUAL_INDENT = 2
_IN_BRACES = "it is written in braces"
_BLOCK_STYLE = "write it in block style, one key on each line, then migrate"


def lift_device(tree: TreeMap, offsets: Offsets) -> Iterator[Edit | Diagnostic]:
    """Sections at the top level; nothing where they stand there already."""
    devices, sections = devices_of(tree), sections_of(tree)
    if not devices:
        return
    device, *others = devices
    assert isinstance(device.value, TreeMap)  # `devices_of` asked
    reason = _reason_to_keep_level(tree, device.value, offsets, device)
    if others:
        message = "the device blocks stay: sections at the top level are one device, there are "
        yield kept(f"{message}{len(devices)}", others[0].key_span)
    elif sections:
        yield kept(f"section `{sections[0].key}` stands beside a device", sections[0].key_span)
    elif device.key != ONE_DEVICE:
        message = f"the device block stays: sections at the top level are the device `{ONE_DEVICE}`"
        yield kept(message, device.key_span)
    elif reason is not None:
        help = _BLOCK_STYLE if reason == _IN_BRACES else None
        yield kept(f"the device block stays: {reason}", device.key_span, help)
    else:
        yield from _lift_lines(tree, device, offsets)


def _reason_to_keep_level(
    tree: TreeMap, block: TreeMap, offsets: Offsets, device: Entry
) -> str | None:
    if tree.get("include") is not None:
        return "an included file would have to change its level at the same moment"
    start, end = offsets.end(device.key_span), offsets.start(block.span)
    if end < start or _PLAIN_COLON.fullmatch(offsets.source.text[start:end]) is None:
        return "it is written by an anchor or with `?`"
    if block.span.text[:1] in ("&", "!"):
        return "it has an anchor or a tag"
    if is_flow(tree) or is_flow(block):
        return _IN_BRACES
    taken = {entry.key for entry in tree} & {entry.key for entry in block}
    return f"`{min(taken)}` stands outside it too" if taken else None


def _lift_lines(tree: TreeMap, device: Entry, offsets: Offsets) -> Iterator[Edit]:
    text, line = offsets.source.text, device.key_span.line
    start = offsets.start(device.key_span)
    behind = _BEHIND_COLON.match(text, offsets.end(device.key_span))
    assert isinstance(device.value, TreeMap)
    assert behind is not None  # a block mapping starts on a line of its own
    if behind[1]:
        yield offsets.edit(start, behind.end())
    else:
        yield offsets.edit(offsets.at(line), offsets.at(line + 1))
    base = device.key_span.column - 1
    depth = device.value.span.column - 1 - base
    for number in range(line + 1, _end_line(tree, device, offsets)):
        indent = indent_of(offsets.source.line(number))
        surplus = min(depth, max(indent - base, 0))
        if surplus:
            yield offsets.edit(offsets.at(number), offsets.at(number) + surplus)


def nest_sections(tree: TreeMap, offsets: Offsets) -> Iterator[Edit | Diagnostic]:
    """The sections inside a device block; nothing where they are in one already."""
    sections = sections_of(tree)
    if not sections:
        return
    include = tree.get("include")
    first, last = tree.entries.index(sections[0]), tree.entries.index(sections[-1])
    between = [entry for entry in tree.entries[first:last] if entry not in sections]
    if devices := devices_of(tree):
        yield kept(f"device `{devices[0].key}` stands beside sections", devices[0].key_span)
    elif include is not None:
        message = "the sections stay at the top level: an included file would have to change at "
        yield kept(f"{message}the same moment", include.key_span)
    elif between:
        message = f"the sections stay at the top level: `{between[0].key}` stands between them"
        yield kept(message, between[0].key_span, "move it in front of the sections")
    elif is_flow(tree):
        message = f"the sections stay at the top level: {_IN_BRACES}"
        yield kept(message, sections[0].key_span, _BLOCK_STYLE)
    else:
        yield from _nest_lines(tree, sections, offsets)


def _nest_lines(tree: TreeMap, sections: tuple[Entry, ...], offsets: Offsets) -> Iterator[Edit]:
    source, head = offsets.source, sections[0].key_span
    depth, base = _depth(sections), head.column - 1
    block = f"{' ' * base}{ONE_DEVICE}:{line_end_of(source.text)}"
    end = _end_line(tree, sections[-1], offsets)
    last = max(n for n in range(head.line, end) if _is_content(source.line(n)))
    for number in range(head.line, end):
        line = source.line(number)
        moves = bool(line) if number <= last else indent_of(line) > base and bool(line.strip())
        if moves:
            start = offsets.at(number)
            yield offsets.edit(start, start, (block if number == head.line else "") + " " * depth)


def _depth(sections: tuple[Entry, ...]) -> int:
    """How far this file indents: its own smallest step, else the usual one."""
    steps = (section.value.span.column - section.key_span.column for section in sections)
    return min((step for step in steps if step > 0), default=_USUAL_INDENT)


def _end_line(tree: TreeMap, entry: Entry, offsets: Offsets) -> int:
    """The line after the last one of an entry of the top level, comments behind it counted in."""
    line = entry.key_span.line
    later = [other.key_span.line for other in tree if other.key_span.line > line]
    end = min(later, default=len(offsets.source.lines) + 1)
    marked = (n for n in range(line + 1, end) if offsets.source.line(n).startswith(("...", "---")))
    return next(marked, end)


def _is_content(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def kept(message: str, span: Span, help: str | None = None) -> Diagnostic:
    """A finding about something that cannot be rewritten; no fault of the config."""
    return Diagnostic(code="migrate", severity="info", message=message, span=span, help=help)
