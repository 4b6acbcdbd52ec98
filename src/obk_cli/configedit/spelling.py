"""The parts of a config that the two syntaxes write differently: levels and components.

This module returns devices, sections and components of a tree, with the values that both syntaxes
share. It does not report errors; the checks do.
"""

from collections.abc import Iterable, Iterator
from typing import Literal

from obelisk_spec.components import SETTING_SUFFIX, component_identity
from obk_cli.config.fields import RESERVED_KEYS, SECTION_KEYS
from obk_cli.config.model import COMPONENT_LISTS, NODE_SECTIONS, ONE_DEVICE
from obk_cli.config.reader import is_device
from obk_cli.config.tree import Entry, Tree, TreeList, TreeMap, TreeScalar, plain_value

__all__ = [
    "Spelling",
    "components_of",
    "devices_of",
    "is_config",
    "meaning",
    "sections_of",
    "text_of",
]

Spelling = Literal["key", "seed"]
"""`seed`: device blocks and `ros_parameter`; `key`: sections at the top level and `key`."""


def is_config(tree: TreeMap) -> bool:
    """Whether a mapping contains any part of a config."""
    return bool(devices_of(tree)) or any(entry.key in RESERVED_KEYS for entry in tree)


def devices_of(tree: TreeMap) -> tuple[Entry, ...]:
    """The device blocks, each of which contains a mapping."""
    return tuple(entry for entry in tree if is_device(entry))


def sections_of(tree: TreeMap) -> tuple[Entry, ...]:
    """The sections directly in this mapping."""
    return tuple(entry for entry in tree if entry.key in SECTION_KEYS)


def components_of(tree: TreeMap) -> Iterator[TreeMap]:
    """Every publisher, subscriber and timer of every node, in either syntax."""
    for holder in (tree, *(device.value for device in devices_of(tree))):
        for section in sections_of(holder) if isinstance(holder, TreeMap) else ():
            for node in _nodes(section):
                yield from _inside(node, COMPONENT_LISTS)


def _nodes(section: Entry) -> Iterator[TreeMap]:
    if section.key in NODE_SECTIONS:
        yield from _maps(section.value)
    elif section.key == "viz" and isinstance(section.value, TreeMap):
        yield from _inside(section.value, ("viz_nodes",))


def _inside(tree: TreeMap, keys: Iterable[str]) -> Iterator[TreeMap]:
    entries = (tree.get(key) for key in keys)
    return (item for entry in entries if entry is not None for item in _maps(entry.value))


def _maps(tree: Tree) -> Iterator[TreeMap]:
    items = tree.items if isinstance(tree, TreeList) else (tree,)
    return (item for item in items if isinstance(item, TreeMap))


def text_of(entry: Entry | None) -> str | None:
    """The text of a key's value."""
    if entry is None or not isinstance(entry.value, TreeScalar):
        return None
    return entry.value.value if isinstance(entry.value.value, str) else None


def meaning(tree: TreeMap) -> str:
    """The meaning of a config, which is the same in both syntaxes."""
    components = {id(component) for component in components_of(tree)}
    devices = devices_of(tree)
    if not devices and sections_of(tree):
        sections = sections_of(tree)
        outside = tuple(entry for entry in tree if entry not in sections)
        block = Entry(ONE_DEVICE, tree.span, TreeMap(sections, tree.span))
        tree = TreeMap((*outside, block), tree.span)
    return _meaning(tree, components)


def _meaning(tree: Tree, components: set[int]) -> str:
    match tree:
        case TreeMap():
            fields = {entry.key: _meaning(entry.value, components) for entry in tree}
            if id(tree) in components:
                fields |= _component_names(tree, fields)
            return f"{{{sorted(fields.items())}}}"
        case TreeList():
            return f"[{[_meaning(item, components) for item in tree.items]}]"
        case TreeScalar():
            return repr(plain_value(tree))


def _component_names(tree: TreeMap, fields: dict[str, str]) -> dict[str, str]:
    """The name that both names of a component stand for, if they agree."""
    parameter, key = text_of(tree.get("ros_parameter")), text_of(tree.get("key"))
    names = {name for name in (parameter, key) if name is not None}
    identities = {component_identity(name) for name in names}
    is_odd = parameter is not None and not parameter.endswith(SETTING_SUFFIX)
    if len(identities) != 1 or is_odd:
        return {}
    fields.pop("ros_parameter", None)
    return {"key": identities.pop()}
