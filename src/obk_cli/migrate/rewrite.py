"""The whole rewriting of one text, and the proof that it still says the same.

A source in; the new text, what stays and why, or the faults of a text that is no config. Opens no
file; what the text includes is not followed.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from obk_cli.config.tree import Entry, Tree, TreeList, TreeMap, kind_of
from obk_cli.config.yaml_parser import parse_source
from obk_cli.diagnostics.diagnostic import Diagnostic, found, in_order
from obk_cli.diagnostics.edits import Edit, Offsets, apply_edits
from obk_cli.diagnostics.source import SourceFile, Span
from obk_cli.migrate.components import rename_component
from obk_cli.migrate.kept import kept
from obk_cli.migrate.levels import lift_device, nest_sections
from obk_cli.migrate.shape import Spelling, components_of, is_config, meaning

__all__ = ["Migrated", "migrate_source"]


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
    text = _proved(source, tree, edits)
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
        yield from rename_component(component, to, offsets)


def _not_followed(include: Entry) -> Iterator[Diagnostic]:
    items = include.value.items if isinstance(include.value, TreeList) else (include.value,)
    for item in items:
        yield kept("the included file is not rewritten; migrate it too", item.span)


def _proved(source: SourceFile, tree: TreeMap, edits: list[Edit]) -> str | None:
    """The new text if it reads back to the same meaning."""
    try:
        text = apply_edits(source, edits)
    except ValueError:
        return None
    again = parse_source(SourceFile.of(source.path, text))
    if again.diagnostics or not isinstance(again.tree, TreeMap):
        return None
    return text if meaning(again.tree) == meaning(tree) else None
