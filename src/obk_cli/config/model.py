"""The typed config: each field of a stack has the location where it is set.

It is created from a tree and contains what the user wrote, without defaults.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Final, Generic, Literal, TypeVar

from obelisk_spec.components import (
    CONTROL_SUBSCRIPTION,
    SETTING_SUFFIX,
    component_identity,
    standard_component,
)
from obelisk_spec.values import ParameterValue
from obk_cli.config.tree import TreeMap, plain_value
from obk_cli.diagnostics.source import Span
from obk_cli.errors import CommandFailedError

__all__ = [
    "COMPONENT_LISTS",
    "FEEDBACK_TOPIC",
    "JOYSTICK_EXECUTABLE",
    "JOYSTICK_NODE",
    "JOYSTICK_PACKAGE",
    "JOYSTICK_TOPIC",
    "NODE_SECTIONS",
    "ONE_DEVICE",
    "PARAMS_PACKAGE",
    "SIMULATOR_PACKAGE",
    "SIM_PARAMETER",
    "CallbackGroup",
    "Component",
    "ComponentKind",
    "ConfigParameter",
    "ExternalTopic",
    "FileSearch",
    "Joystick",
    "Node",
    "Qos",
    "Remapping",
    "SensorGroup",
    "Sim",
    "Spanned",
    "Stack",
    "refuse_hardware",
]


T = TypeVar("T")

ComponentKind = Literal["publisher", "subscriber", "timer"]

COMPONENT_LISTS: Final[Mapping[str, ComponentKind]] = MappingProxyType(
    {"publishers": "publisher", "subscribers": "subscriber", "timers": "timer"}
)
"""Key of a node -> kind of the components in its list."""

NODE_SECTIONS = ("control", "estimation", "robot", "sensing")
"""Sections that are lists of nodes; `viz` holds nodes one level deeper."""

ONE_DEVICE = "onboard"
"""The device of a config whose sections are at the top level."""

PARAMS_PACKAGE = "params_path_pkg"
"""Parameter with the package whose share folder contains the file of `params_path`."""

SIM_PARAMETER = f"mujoco{SETTING_SUFFIX}"
"""The ROS parameter of a `sim` block without `ros_parameter`."""

SIMULATOR_PACKAGE = "obelisk_sim_py"
SIMULATOR_EXECUTABLE = "obelisk_mujoco_robot"
"""The simulator: reads the block of `SIM_PARAMETER`, and commands from `u_mujoco`."""


@dataclass(frozen=True, slots=True)
class Spanned(Generic[T]):
    """A value with its location and, if it has one, its key's location."""

    value: T
    span: Span
    key_span: Span | None = None

    @property
    def entry_span(self) -> Span:
        """The location of the key, otherwise of the value."""
        return self.key_span or self.span


@dataclass(frozen=True, slots=True, kw_only=True)
class FileSearch:
    """Where a path in the config was searched."""

    written: Spanned[str]
    found: Path | None
    tried: tuple[Path, ...] = ()
    missing_package: str | None = None
    """A `robot_pkg` that was not found."""
    near: tuple[str, ...] = ()
    """Similar existing files, in the form in which the config would name them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Qos:
    """QoS of one end of a topic."""

    reliability: Spanned[str] | None = None
    durability: Spanned[str] | None = None
    history_depth: Spanned[int] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Component:
    """A publisher, subscriber or timer of a node."""

    kind: ComponentKind
    span: Span
    tree: TreeMap
    ros_parameter: Spanned[str] | None = None
    key: Spanned[str] | None = None
    topic: Spanned[str] | None = None
    msg_type: Spanned[str] | None = None
    ignores_type: bool = False
    """Whether the node is in C++, where only the code determines the type."""
    code_type: str | None = None
    """The full message type in the node's code, if known."""
    qos: Qos = field(default_factory=Qos)
    callback_group: Spanned[str] | None = None
    timer_period_s: Spanned[float] | None = None
    max_age_s: Spanned[float] | None = None
    """Maximum age of a robot's latest command [s]."""
    stale_action: Spanned[str] | None = None
    is_unused: bool = False
    """Whether no node reads it: an earlier entry has its name, or only the hardware has it."""

    @property
    def name(self) -> Spanned[str] | None:
        """The name of the component: its `ros_parameter`, otherwise its `key`."""
        return self.ros_parameter or self.key

    @property
    def identity(self) -> str | None:
        """The component of the code that it refers to, `pub_ctrl`."""
        return component_identity(self.name.value) if self.name else None

    @property
    def takes_commands(self) -> bool:
        """Whether it is the subscription through which a robot receives its commands."""
        standard = standard_component(self.identity or "")
        return self.kind == "subscriber" and standard == CONTROL_SUBSCRIPTION


@dataclass(frozen=True, slots=True, kw_only=True)
class CallbackGroup:
    """A named callback group of a node."""

    name: Spanned[str]
    type: Spanned[str] | None
    """None if the written type is invalid."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfigParameter:
    """A ROS parameter set by the user; nested names are joined with dots."""

    name: str
    value: ParameterValue
    span: Span
    key_span: Span | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Remapping:
    """A name of a node that ROS replaces."""

    old: str
    new: str
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorGroup:
    """Sensors of the model that are published together."""

    topic: Spanned[str]
    msg_type: Spanned[str] | None
    period_s: Spanned[float] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Sim:
    """One `sim` block; `tree` is the block with the current names of its keys."""

    tree: TreeMap
    ros_parameter: Spanned[str] | None
    model_xml_path: Spanned[str] | None
    robot_pkg: Spanned[str] | None
    sensor_groups: tuple[SensorGroup, ...]
    config_paths: tuple[Spanned[str], ...] = ()
    is_sound: bool = True
    """Whether the block was read without an error, so that further checks make sense."""
    model: FileSearch | None = None
    files: tuple[FileSearch, ...] = ()
    checked: TreeMap | None = None
    """`tree` with the files of `config_path` inserted, if there are any."""

    @property
    def span(self) -> Span:
        """Where the block starts."""
        return self.tree.span

    @property
    def parameter(self) -> str:
        """The ROS parameter that carries the block."""
        return self.ros_parameter.value if self.ros_parameter else SIM_PARAMETER

    @property
    def block(self) -> dict[str, object]:
        """The block as plain values."""
        value = plain_value(self.tree)
        assert isinstance(value, dict)  # the value of a TreeMap is a dict
        return value


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """One ROS node of the stack."""

    section: str
    device: str
    index: int
    """Position among the nodes of its section, on all devices, from 0."""
    span: Span
    pkg: Spanned[str] | None = None
    executable: Spanned[str] | None = None
    name: Spanned[str] | None = None
    namespace: Spanned[str] | None = None
    params_path: Spanned[str] | None = None
    params: tuple[ConfigParameter, ...] = ()
    callback_groups: tuple[CallbackGroup, ...] = ()
    components: tuple[Component, ...] = ()
    remappings: tuple[Remapping, ...] = ()
    env: tuple[tuple[str, str], ...] = ()
    log_level: Spanned[str] | None = None
    respawn: Spanned[bool] | None = None
    on_crash: Spanned[str] | None = None
    is_simulated: Spanned[bool] | None = None
    sims: tuple[Sim, ...] = ()
    robot_pkg: Spanned[str] | None = None
    urdf: Spanned[str] | None = None
    robot_topic: Spanned[str] | None = None
    tf_prefix: Spanned[str] | None = None
    params_file: FileSearch | None = None
    urdf_file: FileSearch | None = None

    @property
    def params_package(self) -> Spanned[str] | None:
        """The package of `params_path`: the `params_path_pkg` parameter, otherwise its own."""
        package = next((p for p in self.params if p.name == PARAMS_PACKAGE), None)
        if package is None or not isinstance(package.value, str):
            return self.pkg
        return Spanned(package.value, package.span)

    @property
    def used_components(self) -> tuple[Component, ...]:
        """The components that the node reads."""
        return tuple(component for component in self.components if not component.is_unused)

    @property
    def node_name(self) -> str:
        """The node's ROS name without its namespace, `obelisk_control_0`."""
        return f"obelisk_{self.section}_{self.name.value if self.name else self.index}"

    @property
    def ros_namespace(self) -> str:
        """The node's namespace with its leading `/`."""
        return "/" + (self.namespace.value.strip("/") if self.namespace else "")

    @property
    def full_name(self) -> str:
        """The node's name in the ROS graph."""
        return f"{self.ros_namespace.rstrip('/')}/{self.node_name}"

    @property
    def is_simulator(self) -> bool:
        """Whether it runs Obelisk's own simulator."""
        return self.executable is not None and self.executable.value == SIMULATOR_EXECUTABLE

    @property
    def used_sims(self) -> tuple[Sim, ...]:
        """The `sim` blocks in use; `is_simulated: false` disables them."""
        is_used = self.is_simulated is None or self.is_simulated.value
        return self.sims if is_used else ()

    @property
    def runs_simulation(self) -> bool:
        """Whether a simulator replaces the robot."""
        return bool(self.used_sims)

    @property
    def publishes_clock(self) -> bool:
        """Whether it is known to publish `/clock`, as Obelisk's own simulator does."""
        is_own = self.pkg is not None and self.pkg.value == SIMULATOR_PACKAGE
        return self.runs_simulation and self.is_simulator and is_own


JOYSTICK_PACKAGE = "joy"
JOYSTICK_EXECUTABLE = "joy_node"
JOYSTICK_NODE = "obelisk_joystick"
JOYSTICK_TOPIC = "joy"
FEEDBACK_TOPIC = "joy/set_feedback"
"""Topic of the joystick node of ROS."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Joystick:
    """The joystick node of a stack, which is part of ROS."""

    on: bool
    device: str
    span: Span
    pub_topic: Spanned[str] | None = None
    sub_topic: Spanned[str] | None = None
    params: tuple[ConfigParameter, ...] = ()

    @property
    def full_name(self) -> str:
        """The node's name in the ROS graph, the same for every joystick."""
        return f"/{JOYSTICK_NODE}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ExternalTopic:
    """A topic that nodes outside the stack publish or subscribe to."""

    topic: Spanned[str]
    msg_type: Spanned[str] | None = None
    direction: Spanned[str] | None = None
    """What those nodes do, `published` or `subscribed`; None: either or both."""

    @property
    def name(self) -> str:
        """The topic's name in the ROS graph."""
        return "/" + self.topic.value.lstrip("/")

    def may_be(self, direction: str) -> bool:
        """Whether a node outside the stack may have that end of the topic."""
        return self.direction is None or self.direction.value == direction


@dataclass(frozen=True, slots=True, kw_only=True)
class Stack:
    """A whole config."""

    name: Spanned[str] | None
    nodes: tuple[Node, ...]
    span: Span
    joysticks: tuple[Joystick, ...] = ()
    external_topics: tuple[ExternalTopic, ...] = ()
    ignored_codes: tuple[Spanned[str], ...] = ()
    use_sim_time: Spanned[bool] | None = None
    """`obk.use_sim_time`."""

    @property
    def is_on_simulated_time(self) -> bool:
        """Whether nodes use simulated time unless their own parameters set `use_sim_time`.

        By default they do if exactly one node publishes `/clock`: without any, time would stand
        still, and with two it would jump between two simulations.
        """
        if self.use_sim_time is not None:
            return self.use_sim_time.value
        return sum(node.publishes_clock for node in self.nodes) == 1

    def section(self, section: str) -> Iterator[Node]:
        """The nodes of one section."""
        return (node for node in self.nodes if node.section == section)


def refuse_hardware(
    stack: Stack,
    why: str,
    help: str,
    *,
    may_be_unclear: bool = False,
    left_out: Collection[str] = (),
) -> None:
    """Reject a stack that drives a real robot.

    Args:
        stack: the config.
        why: why hardware is rejected, as the end of the error message.
        help: what the user can do.
        may_be_unclear: accept a robot without `is_simulated` and without a `sim` block.
        left_out: full names of nodes that do not run.

    Raises:
        CommandFailedError: the stack drives a real robot.
    """
    for robot in stack.section("robot"):
        setting = robot.is_simulated
        if robot.full_name in left_out or robot.runs_simulation:
            continue
        if may_be_unclear if setting is None else setting.value:
            continue
        span = setting.span if setting else robot.span
        raise CommandFailedError(
            f"{span.path}:{span.line}:{span.column}: the robot {robot.full_name} is hardware, "
            f"and {why}",
            help=help,
        )
