"""The intermediate form: which nodes run, with which parameters, in which order they come up.

What comes out of `lower`, and all that a back end or the launcher needs to know of a config.
Holds no YAML and no ROS types.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from obelisk_spec.components import TIERS
from obelisk_spec.values import ParameterValue

__all__ = [
    "TIERS",
    "Endpoint",
    "OnCrash",
    "Origin",
    "ParameterValue",
    "Plan",
    "PlannedNode",
    "PlannedSensorGroup",
    "Promise",
]

OnCrash = Literal["stop", "restart", "ignore"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """The place in the user's text that made something; line and column count from 1."""

    path: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.path}:{self.line}:{self.column}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Endpoint:
    """One end of a topic; `msg_type` is full (`pkg/msg/Name`) or None where only the code knows it.

    `rate_hz` [Hz] is what the config promises, None where nothing in it sets the pace.
    """

    topic: str
    msg_type: str | None
    rate_hz: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedSensorGroup:
    """What a simulator reads from its model and publishes on one topic."""

    topic: str
    """Absolute; one of the node's own publishing ends."""
    kind: str
    """The group's `msg_type` as the config has it, `ObkImu`."""
    sensors: Mapping[str, str] = field(default_factory=dict)
    """MuJoCo sensor name -> MuJoCo sensor type."""
    rays: str | None = None
    """The pattern of a ray caster, `lidar_scan`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Promise:
    """A rate that a node is to keep."""

    name: str
    """A timer's key, or the absolute topic of a sensor group."""
    period_s: float
    """Of a sensor group in simulation time [s]."""
    origin: Origin
    """The place of the period."""
    topic: str | None = None
    """On which the node publishes once in each period; None: no topic shows this rate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedNode:
    """A node, and how its process is started."""

    node: str
    """Node name without its namespace, `obelisk_control_0`."""
    namespace: str
    """ROS namespace, `/` where none is given."""
    section: str
    device: str
    package: str
    executable: str
    origin: Origin
    parameters: Mapping[str, ParameterValue] = field(default_factory=dict)
    remappings: tuple[tuple[str, str], ...] = ()
    env: Mapping[str, str] = field(default_factory=dict)
    log_level: str | None = None
    publishes: tuple[Endpoint, ...] = ()
    subscribes: tuple[Endpoint, ...] = ()
    model: str | None = None
    """Path of the MuJoCo model that stands in for the robot."""
    sensor_groups: tuple[PlannedSensorGroup, ...] = ()
    promises: tuple[Promise, ...] = ()
    on_crash: OnCrash | None = None
    """What the launcher does when it crashes; None: as `obk launch` is called with."""
    has_lifecycle: bool = True
    """Whether the node has a life cycle; ROS's joystick node does not."""

    @property
    def full_name(self) -> str:
        """The node's name in the ROS graph, `/ns/obelisk_control_0`."""
        return f"{self.namespace.rstrip('/')}/{self.node}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """A whole stack."""

    name: str
    nodes: tuple[PlannedNode, ...]
    external_topics: tuple[str, ...] = ()
    """Topics that nodes outside the stack publish."""

    @property
    def tiers(self) -> tuple[tuple[PlannedNode, ...], ...]:
        """The nodes in bring-up order, a tuple for each tier that has any."""
        tiers = (tuple(node for node in self.nodes if node.section == section) for section in TIERS)
        return tuple(tier for tier in tiers if tier)
