"""The plan: which nodes run, with which parameters, and in which order they come up.

`lower` creates it. It holds everything that a back end or the launcher needs from a config, and no
YAML or ROS types.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from obelisk_spec.components import TIERS
from obelisk_spec.values import OnCrash, ParameterValue

__all__ = [
    "TIERS",
    "Endpoint",
    "OnCrash",
    "Origin",
    "ParameterValue",
    "Plan",
    "PlannedActuator",
    "PlannedNode",
    "PlannedRate",
    "PlannedSensorGroup",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """The location in the user's text that defined something; line and column count from 1."""

    path: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.path}:{self.line}:{self.column}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Endpoint:
    """One end of a topic; `msg_type` is full (`pkg/msg/Name`), or None if only the code knows it.

    `rate_hz` [Hz] is the rate that the config implies; None if the config does not determine it.
    """

    topic: str
    msg_type: str | None
    rate_hz: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedSensorGroup:
    """The values that a simulator reads from its model and publishes on one topic."""

    topic: str
    """Absolute; one of the node's publishers."""
    kind: str
    """The group's `msg_type` as in the config, `ObkImu`."""
    sensors: Mapping[str, str] = field(default_factory=dict)
    """MuJoCo sensor name -> MuJoCo sensor type."""
    rays: str | None = None
    """The pattern of a ray caster, `lidar_scan`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedActuator:
    """An actuator of a simulator's model, which one number of `u_mujoco` controls."""

    name: str
    """Empty if neither it nor its joint has a name."""
    unit: str
    """Unit of its control, `N m`; empty if unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedRate:
    """An expected rate of a node."""

    name: str
    """A timer's key, or the absolute topic of a sensor group."""
    period_s: float
    """[s]; for a sensor group in simulated time."""
    origin: Origin
    """Location of the period in the config."""
    topic: str | None = None
    """Topic on which the node publishes once per period; None: no topic shows this rate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedNode:
    """A node and how to start its process."""

    node: str
    """Node name without its namespace, `obelisk_control_0`."""
    namespace: str
    """ROS namespace; `/` if none is given."""
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
    """Path of the MuJoCo model that replaces the robot."""
    sensor_groups: tuple[PlannedSensorGroup, ...] = ()
    actuators: tuple[PlannedActuator, ...] = ()
    """Actuators of the model, in its order; empty if it could not be read."""
    rates: tuple[PlannedRate, ...] = ()
    on_crash: OnCrash | None = None
    """What the launcher does when the node crashes; None: the default of `obk launch`."""
    has_lifecycle: bool = True
    """Whether the node has a lifecycle; ROS's joystick node has none."""

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
        """The nodes in bring-up order, one tuple per non-empty tier."""
        tiers = (tuple(node for node in self.nodes if node.section == section) for section in TIERS)
        return tuple(tier for tier in tiers if tier)
