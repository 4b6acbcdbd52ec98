"""The graph that all diagrams show: the nodes, the topics, and their properties.

Nodes are in bring-up order, topics in the order in which the nodes refer to them.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePath
from types import MappingProxyType
from typing import Final

from obelisk_spec.components import TIERS
from obelisk_spec.suggestions import with_number
from obk_cli.plan.plan import Endpoint, Plan, PlannedNode, PlannedSensorGroup
from obk_cli.terminal import printable

__all__ = ["SECTION_COLOURS", "Graph", "GraphNode", "GraphTopic", "graph_of"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Colour:
    """A light and a dark shade of one color."""

    light: str
    """For areas with text."""
    dark: str
    """For lines and headings, legible on white and on `light`."""


SECTION_COLOURS: Final[Mapping[str, Colour]] = MappingProxyType(
    {
        "robot": Colour(light="#e6f4ea", dark="#1a7f37"),
        "sensing": Colour(light="#e0f4f7", dark="#0b7285"),
        "estimation": Colour(light="#ddf0ff", dark="#0969da"),
        "control": Colour(light="#fff1e0", dark="#b35900"),
        "viz": Colour(light="#f3ebff", dark="#7a44c9"),
        "joystick": Colour(light="#ffe9ef", dark="#bf3989"),
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphNode:
    """A node of the stack."""

    name: str
    """Full name."""
    section: str
    device: str
    package: str
    executable: str
    model: str | None
    """Path of the MuJoCo model that replaces the robot."""

    @property
    def title(self) -> str:
        """The name, without the leading slash of names in the root namespace."""
        return printable(self.name if self.name.count("/") > 1 else self.name.lstrip("/"))

    @property
    def facts(self) -> tuple[str, ...]:
        """The lines that a diagram shows below the title."""
        model = (f"MuJoCo {PurePath(self.model).name}",) if self.model else ()
        return tuple(printable(fact) for fact in (self.package, self.executable, *model))


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphTopic:
    """A topic, and the full names of the nodes at its endpoints."""

    name: str
    msg_type: str | None
    rate_hz: float | None
    publishers: tuple[str, ...]
    subscribers: tuple[str, ...]
    sensor_groups: tuple[PlannedSensorGroup, ...]
    """The sensor groups that the simulator publishes on it."""

    @property
    def title(self) -> str:
        """The name with non-printable characters replaced."""
        return printable(self.name)

    @property
    def summary(self) -> str:
        """Type and rate: `ObkImu, 500 Hz`."""
        kind = self.msg_type.rpartition("/")[2] if self.msg_type else "type set in the code"
        return printable(kind if self.rate_hz is None else f"{kind}, {_rate(self.rate_hz)}")

    @property
    def sensors(self) -> tuple[str, ...]:
        """One line per kind of sensor: `jointpos hip_sensor +11`, `lidar_scan rays`."""
        return tuple(
            printable(line) for group in self.sensor_groups for line in _sensor_lines(group)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Graph:
    """A stack as shown in a diagram."""

    name: str
    nodes: tuple[GraphNode, ...]
    topics: tuple[GraphTopic, ...]

    @property
    def devices(self) -> tuple[str, ...]:
        """The devices, in the order of the nodes."""
        return tuple(dict.fromkeys(node.device for node in self.nodes))

    def topics_within(self, device: str | None) -> tuple[GraphTopic, ...]:
        """The topics within one device; None: the topics between devices."""
        devices = {node.name: node.device for node in self.nodes}
        endpoints = [{devices[n] for n in (*t.publishers, *t.subscribers)} for t in self.topics]
        return tuple(
            topic
            for topic, at in zip(self.topics, endpoints, strict=True)
            if (len(at) > 1 if device is None else at == {device})
        )

    @property
    def title(self) -> str:
        """The stack's name and the number of its nodes and topics."""
        nodes, topics = with_number(len(self.nodes), "node"), with_number(len(self.topics), "topic")
        return printable(f"{self.name}: {nodes}, {topics}")


@dataclass(frozen=True, slots=True)
class _Endpoint:
    node: str
    is_published: bool
    endpoint: Endpoint


def graph_of(plan: Plan) -> Graph:
    """The graph of a plan."""
    nodes = sorted(plan.nodes, key=lambda node: TIERS.index(node.section))
    by_topic: dict[str, list[_Endpoint]] = {}
    for node in nodes:
        for is_published, endpoints in ((True, node.publishes), (False, node.subscribes)):
            for endpoint in endpoints:
                end = _Endpoint(node.full_name, is_published, endpoint)
                by_topic.setdefault(endpoint.topic, []).append(end)
    groups: dict[str, list[PlannedSensorGroup]] = {}
    for group in (group for node in nodes for group in node.sensor_groups):
        groups.setdefault(group.topic, []).append(group)
    return Graph(
        name=plan.name,
        nodes=tuple(_node(node) for node in nodes),
        topics=tuple(_topic(name, own, groups.get(name, [])) for name, own in by_topic.items()),
    )


def _node(node: PlannedNode) -> GraphNode:
    return GraphNode(
        name=node.full_name,
        section=node.section,
        device=node.device,
        package=node.package,
        executable=node.executable,
        model=node.model,
    )


def _topic(name: str, endpoints: list[_Endpoint], groups: list[PlannedSensorGroup]) -> GraphTopic:
    types = (end.endpoint.msg_type for end in endpoints)
    rates = (end.endpoint.rate_hz for end in endpoints)
    return GraphTopic(
        name=name,
        msg_type=next((msg_type for msg_type in types if msg_type), None),
        rate_hz=next((rate for rate in rates if rate), None),
        publishers=tuple(dict.fromkeys(end.node for end in endpoints if end.is_published)),
        subscribers=tuple(dict.fromkeys(end.node for end in endpoints if not end.is_published)),
        sensor_groups=tuple(groups),
    )


def _sensor_lines(group: PlannedSensorGroup) -> Iterator[str]:
    by_type: dict[str, list[str]] = {}
    for name, kind in group.sensors.items():
        by_type.setdefault(kind, []).append(name)
    for kind, names in by_type.items():
        yield f"{kind} {names[0]}" + (f" +{len(names) - 1}" if len(names) > 1 else "")
    if group.rays is not None:
        yield f"{group.rays} rays"


def _rate(rate_hz: float) -> str:
    return f"{rate_hz:.0f} Hz" if rate_hz >= 100 else f"{rate_hz:.3g} Hz"
