"""Put one tree over another: a config over what it includes, `--set path=value` over a config.

Pure; each value keeps its place.
"""

import re
from collections.abc import Iterable

from obelisk_spec.components import component_identity
from obelisk_spec.suggestions import did_you_mean
from obk_cli.config.tree import Entry, Tree, TreeList, TreeMap, TreeScalar, kind_of
from obk_cli.config.yaml_parser import parse_source
from obk_cli.diagnostics.diagnostic import Diagnostic, found
from obk_cli.diagnostics.source import COMMAND_LINE, SourceFile, Span

__all__ = ["apply_overrides", "merge_trees"]

Identity = tuple[str, str]

_IDENTITY_KEYS = ("name", "id", "key", "ros_parameter", "topic")
_COMPONENT_KEYS = ("key", "ros_parameter")


_STEP = re.compile(r"(?:^|\.)([A-Za-z_][\w-]*)|\[([0-9]{1,9})\]")
_MOST_STEPS = 100


def merge_trees(inner: Tree, outer: Tree) -> Tree:
    """`outer` over `inner`: mappings key by key, lists of mappings by identity, else outer wins."""
    match inner, outer:
        case TreeMap(), TreeMap():
            return _merge_maps(inner, outer)
        case ((TreeList() | TreeMap()), (TreeList() | TreeMap())):
            inner_items, outer_items = _as_maps(inner), _as_maps(outer)
            if inner_items is not None and outer_items is not None:
                return TreeList(_merge_items(inner_items, outer_items), outer.span)
    return outer


def _merge_maps(inner: TreeMap, outer: TreeMap) -> TreeMap:
    over = {entry.key: entry for entry in outer}
    merged = [_merge_entry(entry, over.pop(entry.key, None)) for entry in inner]
    kept = [entry for entry in merged if entry is not None]
    return TreeMap((*kept, *over.values()), outer.span)


def _merge_entry(inner: Entry, outer: Entry | None) -> Entry | None:
    """The merged entry; None where the outer file sets the key to null and so removes it."""
    if outer is None:
        return inner
    if isinstance(outer.value, TreeScalar) and outer.value.value is None:
        return None
    return Entry(outer.key, outer.key_span, merge_trees(inner.value, outer.value))


def _as_maps(tree: TreeList | TreeMap) -> tuple[TreeMap, ...] | None:
    """The mappings of a list; one mapping stands for a list of one; None for other lists."""
    items = (tree,) if isinstance(tree, TreeMap) else tree.items
    maps = tuple(item for item in items if isinstance(item, TreeMap))
    return maps if len(maps) == len(items) else None


def _merge_items(inner: tuple[TreeMap, ...], outer: tuple[TreeMap, ...]) -> tuple[TreeMap, ...]:
    merged = list(inner)
    places = {_identity(item): index for index, item in enumerate(inner)}
    for item in outer:
        identity = _identity(item)
        index = None if identity is None else places.get(identity)
        if index is None:
            merged.append(item)
        else:
            merged[index] = _merge_maps(merged[index], item)
    return tuple(merged)


def _identity(item: TreeMap) -> Identity | None:
    """What makes an item the same as another: its first naming key and that key's value."""
    for key in _IDENTITY_KEYS:
        entry = item.get(key)
        if entry is None or not isinstance(entry.value, TreeScalar) or entry.value.value is None:
            continue
        text = str(entry.value.value)
        return ("component", component_identity(text)) if key in _COMPONENT_KEYS else (key, text)
    return None


class _UnfitError(Exception):
    """A path that leads nowhere; its help says what is there."""

    def __init__(self, message: str, help: str | None = None) -> None:
        super().__init__(message)
        self.help = help


def apply_overrides(
    tree: TreeMap, options: Iterable[str]
) -> tuple[TreeMap, tuple[Diagnostic, ...]]:
    """The tree with each option set in turn; the place of a value set is `<command line>`."""
    faults: list[Diagnostic] = []
    for option in options:
        span = Span.at(SourceFile.of(COMMAND_LINE, option), 1, 1, max(len(option), 1))
        try:
            path, text = _split(option)
            parsed = parse_source(SourceFile.of(COMMAND_LINE, text))
            faults += parsed.diagnostics
            if parsed.tree is not None and not parsed.diagnostics:
                new = _set(tree, path, parsed.tree, span)
                tree = new if isinstance(new, TreeMap) else tree
        except _UnfitError as error:
            faults.append(found("OBK012", f"`--set {option}`: {error}", span, help=error.help))
    return tree, tuple(faults)


def _split(option: str) -> tuple[list[str | int], str]:
    path, equals, text = option.partition("=")
    if not equals:
        raise _UnfitError("there is no `=`", "write it as `path=value`")
    steps: list[str | int] = []
    at = 0
    while at < len(path):
        step = _STEP.match(path, at)
        if step is None or (at == 0 and path.startswith((".", "["))):
            raise _UnfitError(f"`{path}` is not a path", "write it as `robot[0].sim[0].time_step`")
        steps.append(step[1] if step[1] is not None else int(step[2]))
        at = step.end()
    if not steps:
        raise _UnfitError("the path is empty", "write it as `robot[0].sim[0].time_step`")
    if len(steps) > _MOST_STEPS:
        raise _UnfitError(f"the path has {len(steps)} steps, expected at most {_MOST_STEPS}")
    return steps, text or "~"


def _set(tree: Tree | None, path: list[str | int], value: Tree, span: Span) -> Tree:
    if not path:
        return value
    step, rest = path[0], path[1:]
    if isinstance(step, str):
        return _set_key(tree, step, rest, value, span)
    if isinstance(tree, TreeMap) and step == 0:
        return _set(tree, rest, value, span)
    if not isinstance(tree, TreeList):
        what = "nothing" if tree is None else kind_of(tree)
        raise _UnfitError(f"`[{step}]` needs a list, there is {what}")
    if step >= len(tree.items):
        count = len(tree.items)
        raise _UnfitError(f"`[{step}]` is past the end, the list has {count} (from [0])")
    items = list(tree.items)
    items[step] = _set(items[step], rest, value, span)
    return TreeList(tuple(items), tree.span)


def _set_key(
    tree: Tree | None, key: str, rest: list[str | int], value: Tree, span: Span
) -> TreeMap:
    if tree is None:
        tree = TreeMap((), span)
    if not isinstance(tree, TreeMap):
        raise _UnfitError(f"`{key}` needs a mapping, there is {kind_of(tree)}")
    old = tree.get(key)
    if old is None and rest and isinstance(rest[0], int):
        known = [entry.key for entry in tree]
        raise _UnfitError(f"there is no `{key}`", did_you_mean(key, known))
    new = Entry(key, span, _set(old.value if old else None, rest, value, span))
    if old is None:
        return TreeMap((*tree.entries, new), tree.span)
    return TreeMap(tuple(new if entry.key == key else entry for entry in tree), tree.span)
