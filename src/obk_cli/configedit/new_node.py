"""The node to add to a config: its section, endpoints and timers, from the YAML of its entry.

Pure; `obk new` prints such entries.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from obelisk_spec.components import component_identity
from obelisk_spec.names import resolve_msg_type
from obk_cli.config.topology import Direction
from obk_cli.config.tree import TreeList, plain_value
from obk_cli.config.yaml_parser import parse_source
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.source import SourceFile

__all__ = [
    "END_LISTS",
    "NewEndpoint",
    "NewNode",
    "Rejected",
    "components",
    "identity_of",
    "read_new_node",
]

END_LISTS: Mapping[str, Direction] = {
    "publishers": "publishes",
    "subscribers": "subscribes",
}
"""Key of a node -> the direction of the endpoints in its list."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NewEndpoint:
    """A publisher or subscriber that needs a topic."""

    direction: Direction
    component: str
    """`pub_ctrl`"""
    msg_type: str
    """Full name."""
    spelling: str
    """The type as written in the entry."""
    leaf: str
    """The last part of the topic that the entry suggests."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NewNode:
    """A node that is not in a config yet."""

    section: str
    entry: Mapping[str, object]

    @property
    def pkg(self) -> str:
        """Its package."""
        return str(self.entry["pkg"])

    @property
    def executable(self) -> str:
        """Its executable, by which messages refer to it."""
        return str(self.entry["executable"])

    @property
    def endpoints(self) -> tuple[NewEndpoint, ...]:
        """Its publishers and subscribers, in the order of the entry."""
        return tuple(
            _end(direction, component)
            for key, direction in END_LISTS.items()
            for component in components(self.entry, key)
        )


def read_new_node(section: str, snippet: str) -> NewNode:
    """Parse a piece of config with one entry of a section's list.

    Raises:
        ValueError: the text is not a list of one mapping with `pkg` and `executable`.
    """
    tree = parse_source(SourceFile.of("<new node>", snippet)).tree
    entries = plain_value(tree) if isinstance(tree, TreeList) else None
    if not isinstance(entries, list) or len(entries) != 1 or not isinstance(entries[0], dict):
        raise ValueError("expected a list of one mapping")
    if not {"pkg", "executable"} <= entries[0].keys():
        raise ValueError("expected `pkg` and `executable`")
    return NewNode(section=section, entry=entries[0])


def components(entry: Mapping[str, object], key: str) -> list[dict[str, object]]:
    """The components under a key of an entry."""
    items = entry.get(key)
    return [item for item in items if isinstance(item, dict)] if isinstance(items, list) else []


def identity_of(component: Mapping[str, object]) -> str:
    """The component of the code that it refers to."""
    return component_identity(str(component.get("ros_parameter") or component.get("key")))


def _end(direction: Direction, component: Mapping[str, object]) -> NewEndpoint:
    spelling = str(component["msg_type"])
    return NewEndpoint(
        direction=direction,
        component=identity_of(component),
        msg_type=resolve_msg_type(spelling) or spelling,
        spelling=spelling,
        leaf=str(component["topic"]).rpartition("/")[2],
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Rejected:
    """Why a node cannot be added, and how to proceed; nothing was changed."""

    sentence: str
    help: str
    component: str | None = None
    """The component of the new node for which nothing fits, `sub_sensor`."""
    findings: tuple[Diagnostic, ...] = ()
    """The config's own errors, or those that the node would cause."""
    snippet: str = ""
    """The new node as YAML to paste, if its entry is known but the text cannot be edited."""
