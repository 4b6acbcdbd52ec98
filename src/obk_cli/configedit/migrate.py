"""Migrate a config's text from one spelling to the other, and verify that its meaning stays.

Pure: a source in; the new text, what stays and why, or the faults of a text that is no config out.
Included files are not followed. A component keeps its name if the other spelling would not mean the
same to every node: a different `key` beside it, a name without `_setting`, an anchor.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from obelisk_spec.components import SETTING_SUFFIX, component_identity
from obk_cli.config.fixes import remove_entry, respell
from obk_cli.config.tree import Entry, Tree, TreeList, TreeMap, kind_of
from obk_cli.config.yaml_parser import parse_source
from obk_cli.configedit.device_level import kept, lift_device, nest_sections
from obk_cli.configedit.shape import Spelling, components_of, is_config, meaning, text_of
from obk_cli.diagnostics.diagnostic import Diagnostic, found, in_order
from obk_cli.diagnostics.edits import Edit, Offsets, apply_edits
from obk_cli.diagnostics.source import SourceFile, Span

__all__ = ["Migrated", "migrate_source"]

_NEW_NAME = {"key": "key", "seed": "ros_parameter"}
_OLD_NAME = {"key": "ros_parameter", "seed": "key"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Migrated:
    """What became of a text."""

    source: SourceFile
    text: str
    """The text in the other spelling; the old one where it has faults."""
    kept: tuple[Diagnostic, ...] = ()
    """What stays as it was, and why."""
    faults: tuple[Diagnostic, ...] = ()
    """Why nothing could be rewritten."""

    @property
    def is_changed(self) -> bool:
        """Whether the new text differs."""
        return self.text != self.source.text


def migrate_source(source: SourceFile, to: Spelling) -> Migrated:
    """Rewrite a text into a spelling; a text that is in it already stays byte for byte."""
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
        message = "the file stays as it is: its anchors or its layout tie the places together"
        help = "write the anchors out and one key on each line, then migrate"
        stays = [kept(message, tree.span, help)]
    return Migrated(source=source, text=text or source.text, kept=in_order(stays))


def _not_a_config(tree: Tree | None, source: SourceFile) -> Diagnostic:
    if tree is None:
        return found("OBK114", "the file is empty, not a config", Span.at(source, 1, 1))
    what = "no section of a config" if isinstance(tree, TreeMap) else f"{kind_of(tree)}, no config"
    return found("OBK114", f"the file holds {what}", tree.span)


def _steps(tree: TreeMap, to: Spelling, offsets: Offsets) -> Iterator[Edit | Diagnostic]:
    include = tree.get("include")
    if include is not None:
        yield from _not_followed(include)
    yield from (lift_device if to == "key" else nest_sections)(tree, offsets)
    for component in components_of(tree):
        yield from _rename_component(component, to, offsets)


def _not_followed(include: Entry) -> Iterator[Diagnostic]:
    items = include.value.items if isinstance(include.value, TreeList) else (include.value,)
    for item in items:
        yield kept("the included file is not rewritten; migrate it too", item.span)


def _verified(source: SourceFile, tree: TreeMap, edits: list[Edit]) -> str | None:
    """The new text if it reads back to the same meaning."""
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
    """The edits that name a component in that spelling, or why it keeps its name."""
    old, new = component.get(_OLD_NAME[to]), component.get(_NEW_NAME[to])
    name = text_of(old)
    if old is None or name is None or (to == "seed" and new is not None):
        return
    reason = _reason_to_keep(name, old, to, offsets)
    if reason is not None:
        yield kept(f"`{old.key}: {name}` stays: {reason}", old.value.span)
    elif new is None:
        yield from _renamed(old, name, to)
    elif component_identity(text_of(new) or "") == component_identity(name):
        yield from remove_entry(component, old)
    else:
        yield kept(
            f"`{old.key}: {name}` stays: the `key` beside it is another name, and nodes may look "
            "for either",
            old.value.span,
        )


def _reason_to_keep(name: str, entry: Entry, to: Spelling, offsets: Offsets) -> str | None:
    if "${" in name:
        return "what it comes to is known only with its variables"
    if to == "key" and (not name.endswith(SETTING_SUFFIX) or name == SETTING_SUFFIX):
        return f"a `key` stands for a parameter that ends in `{SETTING_SUFFIX}`"
    value = entry.value.span
    between = offsets.source.text[offsets.end(entry.key_span) : offsets.start(value)]
    if re.fullmatch(r"[ \t]*:\s*", between) is None or value.text[:1] in ("&", "!"):
        return "it stands in several places, by an anchor"
    if not respell(value, name, name):
        return "it is written with escapes or over several lines"
    return None


def _renamed(entry: Entry, name: str, to: Spelling) -> Iterator[Edit]:
    key = component_identity(name)
    value = key if to == "key" else f"{key}{SETTING_SUFFIX}"
    yield from respell(entry.key_span, entry.key, _NEW_NAME[to])
    yield from respell(entry.value.span, name, value)
