"""Migrate a config's text from one syntax to the other, and verify that its meaning is unchanged.

Pure: returns the new text and what could not be migrated, or the errors in invalid text. Includes
are not followed. A component keeps its name if it also has a different `key`, if the name lacks
`_setting` or has an anchor, or if a comment next to it silences findings.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from obelisk_spec.components import SETTING_SUFFIX, component_identity
from obk_cli.config.fixes import is_flow, remove_entry, respell
from obk_cli.config.model import ONE_DEVICE
from obk_cli.config.suppressions import ignored_on_line
from obk_cli.config.tree import Entry, Tree, TreeList, TreeMap, TreeScalar, kind_of
from obk_cli.config.yaml_parser import parse_source
from obk_cli.configedit.spelling import (
    Spelling,
    components_of,
    devices_of,
    is_config,
    meaning,
    sections_of,
    text_of,
)
from obk_cli.diagnostics.diagnostic import Diagnostic, found, in_order
from obk_cli.diagnostics.edits import Edit, Offsets, apply_edits
from obk_cli.diagnostics.source import SourceFile, Span, indent_of, line_end_of

__all__ = ["Migrated", "migrate_source"]

# `seed` is the syntax of the original Obelisk.
_NEW_NAME = {"key": "key", "seed": "ros_parameter"}
_OLD_NAME = {"key": "ros_parameter", "seed": "key"}
_PLAIN_COLON = re.compile(r"[ \t]*:\s*(?:#[^\r\n]*\s*)*")
_BEHIND_COLON = re.compile(r"[ \t]*:[ \t]*(?=(#)|[\r\n])")
_SILENCES = "the comment on its line silences findings"
_USUAL_INDENT = 2
_IN_BRACES = "the file uses flow style (braces)"
_BLOCK_STYLE = "write it in block style, one key on each line, then migrate"


@dataclass(frozen=True, slots=True, kw_only=True)
class Migrated:
    """The result of a migration."""

    source: SourceFile
    text: str
    """The migrated text; the old text if there are faults."""
    kept: tuple[Diagnostic, ...] = ()
    """What was not migrated, and why."""
    faults: tuple[Diagnostic, ...] = ()
    """Why nothing could be migrated."""

    @property
    def is_changed(self) -> bool:
        """Whether the new text differs."""
        return self.text != self.source.text


def migrate_source(source: SourceFile, to: Spelling) -> Migrated:
    """Convert source text to a syntax; text already in that syntax is returned unchanged."""
    parsed = parse_source(source)
    tree = parsed.tree
    if parsed.diagnostics:
        return Migrated(source=source, text=source.text, faults=parsed.diagnostics)
    if not isinstance(tree, TreeMap) or not is_config(tree):
        return Migrated(source=source, text=source.text, faults=(_not_a_config(tree, source),))
    steps = tuple(_steps(tree, to, Offsets.of(source)))
    edits = [step for step in steps if isinstance(step, Edit)]
    stays = [step for step in steps if isinstance(step, Diagnostic)]
    text = _verified(source, tree, edits)
    if text is None:
        message = "the file cannot be migrated because of its anchors or its layout"
        help = "replace the aliases with their values, put each key on its own line, then migrate"
        stays = [_kept(message, tree.span, help)]
    return Migrated(source=source, text=text or source.text, kept=in_order(stays))


def _not_a_config(tree: Tree | None, source: SourceFile) -> Diagnostic:
    if tree is None or (isinstance(tree, TreeScalar) and tree.value in (None, "")):
        span = tree.span if tree else Span.at(source, 1, 1)
        return found("OBK114", "the file is empty", span)
    is_map = isinstance(tree, TreeMap)
    what = "no config sections" if is_map else f"{kind_of(tree)}, not a config"
    return found("OBK114", f"the file contains {what}", tree.span)


def _steps(tree: TreeMap, to: Spelling, offsets: Offsets) -> Iterator[Edit | Diagnostic]:
    include = tree.get("include")
    if include is not None:
        yield from _not_followed(include)
    yield from (_lift_device if to == "key" else _nest_sections)(tree, offsets)
    for component in components_of(tree):
        yield from _rename_component(component, to, offsets)


def _not_followed(include: Entry) -> Iterator[Diagnostic]:
    items = include.value.items if isinstance(include.value, TreeList) else (include.value,)
    for item in items:
        yield _kept("the included file is not rewritten; migrate it too", item.span)


def _verified(source: SourceFile, tree: TreeMap, edits: list[Edit]) -> str | None:
    """The new text, if its meaning is unchanged."""
    try:
        text = apply_edits(source, edits)
    except ValueError:
        return None
    again = parse_source(SourceFile.of(source.path, text))
    if again.diagnostics or not isinstance(again.tree, TreeMap):
        return None
    return text if meaning(again.tree) == meaning(tree) else None


def _rename_component(
    component: TreeMap, to: Spelling, offsets: Offsets
) -> Iterator[Edit | Diagnostic]:
    """The edits that rename a component for the target syntax, or why it keeps its name."""
    old, new = component.get(_OLD_NAME[to]), component.get(_NEW_NAME[to])
    name = text_of(old)
    if old is None or name is None or (to == "seed" and new is not None):
        return
    reason = _reason_to_keep(name, old, to, offsets)
    if reason is not None:
        yield _kept(f"`{old.key}: {name}` is kept: {reason}", old.value.span)
    elif new is None:
        yield from _renamed(old, name, to)
    elif component_identity(text_of(new) or "") == component_identity(name):
        if ignored_on_line(old.key_span) and old.key_span.line != new.key_span.line:
            yield _kept(f"`{old.key}: {name}` is kept: {_SILENCES}", old.value.span)
        else:
            yield from remove_entry(component, old)
    else:
        yield _kept(
            f"`{old.key}: {name}` is kept: the `key` next to it differs, and nodes may use either",
            old.value.span,
        )


def _reason_to_keep(name: str, entry: Entry, to: Spelling, offsets: Offsets) -> str | None:
    if "${" in name:
        return "its value depends on variables"
    if to == "key" and (not name.endswith(SETTING_SUFFIX) or name == SETTING_SUFFIX):
        return f"a `key` replaces only parameters that end in `{SETTING_SUFFIX}`"
    value = entry.value.span
    between = offsets.source.text[offsets.end(entry.key_span) : offsets.start(value)]
    if re.fullmatch(r"[ \t]*:\s*", between) is None or value.text[:1] in ("&", "!"):
        return "it has an anchor, so aliases may repeat it elsewhere"
    if not respell(value, name, name):
        return "it uses escapes or spans several lines"
    return None


def _renamed(entry: Entry, name: str, to: Spelling) -> Iterator[Edit]:
    key = component_identity(name)
    value = key if to == "key" else f"{key}{SETTING_SUFFIX}"
    yield from respell(entry.key_span, entry.key, _NEW_NAME[to])
    yield from respell(entry.value.span, name, value)


def _lift_device(tree: TreeMap, offsets: Offsets) -> Iterator[Edit | Diagnostic]:
    """Move sections to the top level; no edits if they are already there."""
    devices, sections = devices_of(tree), sections_of(tree)
    if not devices:
        return
    device, *others = devices
    assert isinstance(device.value, TreeMap)  # checked by `devices_of`
    reason = _reason_to_keep_level(tree, device.value, offsets, device)
    if others:
        message = "the device blocks are kept: the top level can hold one device, not"
        yield _kept(f"{message} {len(devices)}", others[0].key_span)
    elif sections:
        yield _kept(f"section `{sections[0].key}` is outside the device", sections[0].key_span)
    elif device.key != ONE_DEVICE:
        reason = f"sections at the top level belong to the device `{ONE_DEVICE}`"
        yield _kept(f"the device block is kept: {reason}", device.key_span)
    elif reason is not None:
        help = _BLOCK_STYLE if reason == _IN_BRACES else None
        yield _kept(f"the device block is kept: {reason}", device.key_span, help)
    else:
        yield from _lift_lines(tree, device, offsets)


def _reason_to_keep_level(
    tree: TreeMap, block: TreeMap, offsets: Offsets, device: Entry
) -> str | None:
    if tree.get("include") is not None:
        return "the sections of an included file would have to move as well"
    start, end = offsets.end(device.key_span), offsets.start(block.span)
    if end < start or _PLAIN_COLON.fullmatch(offsets.source.text[start:end]) is None:
        return "it is written with an anchor or with `?`"
    if block.span.text[:1] in ("&", "!"):
        return "it has an anchor or a tag"
    if is_flow(tree) or is_flow(block):
        return _IN_BRACES
    taken = {entry.key for entry in tree} & {entry.key for entry in block}
    return f"`{min(taken)}` also occurs outside it" if taken else None


def _lift_lines(tree: TreeMap, device: Entry, offsets: Offsets) -> Iterator[Edit]:
    text, line = offsets.source.text, device.key_span.line
    start = offsets.start(device.key_span)
    behind = _BEHIND_COLON.match(text, offsets.end(device.key_span))
    assert isinstance(device.value, TreeMap)
    assert behind is not None  # a block mapping starts on its own line
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


def _nest_sections(tree: TreeMap, offsets: Offsets) -> Iterator[Edit | Diagnostic]:
    """Move the sections into a device block; no edits if they are in one already."""
    sections = sections_of(tree)
    if not sections:
        return
    include = tree.get("include")
    first, last = tree.entries.index(sections[0]), tree.entries.index(sections[-1])
    between = [entry for entry in tree.entries[first:last] if entry not in sections]
    if devices := devices_of(tree):
        yield _kept(f"the sections are outside the device `{devices[0].key}`", devices[0].key_span)
    elif include is not None:
        message = "the sections are kept at the top level: those of an included file would have to "
        yield _kept(f"{message}move as well", include.key_span)
    elif between:
        message = f"the sections are kept at the top level: `{between[0].key}` is between them"
        yield _kept(message, between[0].key_span, "move it above the sections")
    elif is_flow(tree):
        message = f"the sections are kept at the top level: {_IN_BRACES}"
        yield _kept(message, sections[0].key_span, _BLOCK_STYLE)
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
    """The file's smallest indentation step, or the usual step if there is none."""
    steps = (section.value.span.column - section.key_span.column for section in sections)
    return min((step for step in steps if step > 0), default=_USUAL_INDENT)


def _end_line(tree: TreeMap, entry: Entry, offsets: Offsets) -> int:
    """The first line after a top-level entry and the comments that follow it."""
    line = entry.key_span.line
    later = [other.key_span.line for other in tree if other.key_span.line > line]
    end = min(later, default=len(offsets.source.lines) + 1)
    marked = (n for n in range(line + 1, end) if offsets.source.line(n).startswith(("...", "---")))
    return next(marked, end)


def _is_content(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _kept(message: str, span: Span, help: str | None = None) -> Diagnostic:
    """A finding about something that cannot be migrated; the config itself is fine."""
    return Diagnostic(code="migrate", severity="info", message=message, span=span, help=help)
