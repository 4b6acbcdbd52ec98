"""Merging an outer config over an inner one, as `include:` does. Pure; loses no place."""

from obelisk_spec.components import component_identity
from obk_cli.tree import Entry, Tree, TreeList, TreeMap, TreeScalar

__all__ = ["merge_trees"]

Identity = tuple[str, str]

_IDENTITY_KEYS = ("name", "id", "key", "ros_parameter", "topic")
_COMPONENT_KEYS = ("key", "ros_parameter")


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
