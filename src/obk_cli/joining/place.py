"""Where a node is to stand in a text: the mapping that holds its section, and the section.

A text's tree and the stack that it comes to in; a `Place` out, or why the node that makes room is
not in this text.
"""

from dataclasses import dataclass

from obk_cli.config.model import Node, Stack
from obk_cli.config.tree import Entry, TreeList, TreeMap
from obk_cli.config.yaml_parser import parse_source
from obk_cli.joining.refusal import Refused
from obk_cli.joining.style import Style, style_of
from obk_cli.migrate.shape import devices_of, sections_of

__all__ = ["Place", "index_of", "place_of"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where a node is to stand."""

    tree: TreeMap
    """The whole text."""
    section: str
    device: Entry | None = None
    """The block that holds the section; None for sections at the top level."""
    new_device: str | None = None
    """The device whose block is to be made for it."""
    style: Style

    @property
    def holder(self) -> TreeMap:
        """The mapping that has, or is to have, the section."""
        value = self.device.value if self.device else self.tree
        assert isinstance(value, TreeMap)  # a device block is one
        return value

    @property
    def entry(self) -> Entry | None:
        """The section, if it is there."""
        return None if self.new_device else self.holder.get(self.section)


def place_of(tree: TreeMap, stack: Stack, section: str, device: str) -> Place:
    """The place of a section on a device; its block is made where the config has blocks."""
    blocks = {entry.key: entry for entry in devices_of(tree)}
    has_levels = device not in blocks and not sections_of(tree) and _has_blocks(stack)
    return Place(
        tree=tree,
        section=section,
        device=blocks.get(device),
        new_device=device if has_levels else None,
        style=style_of(tree.span.source, tree, section),
    )


def index_of(place: Place, old: Node) -> int | Refused:
    """Which item of the section the node that makes room is."""
    value = place.entry.value if place.entry else None
    items = value.items if isinstance(value, TreeList) else (value,)
    for index, item in enumerate(items):
        if isinstance(item, TreeMap) and item.span.holds(old.span):
            return index
    return Refused(
        sentence=f"`{old.full_name}` does not stand in `{place.tree.span.path}` itself but at "
        f"{old.span}",
        help="replace it there by hand, or write it out in the config that is named",
    )


def _has_blocks(stack: Stack) -> bool:
    """Whether a config has device blocks, in this text or in those that it includes."""
    trees = (parse_source(source).tree for source in {node.span.source for node in stack.nodes})
    return any(isinstance(tree, TreeMap) and devices_of(tree) for tree in trees)
