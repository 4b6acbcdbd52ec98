"""Check the user's request for `obk new`, and turn it into a package spec.

The result is a `PackageSpec` for a `PackageRequest`, or all problems with the request. No files
are read and no messages imported.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Protocol

from obelisk_spec.names import OBELISK_MESSAGES, ROS_MESSAGES, near_msg_types, resolve_msg_type
from obelisk_spec.suggestions import ask_for, list_names, near_names
from obk_cli.scaffold.kinds import (
    NODE_KINDS,
    Kind,
    Language,
    Problem,
    Release,
    check_name,
    recipe_of,
)

__all__ = [
    "USUAL_CPP_SENSOR",
    "USUAL_CTRL",
    "USUAL_EST",
    "USUAL_OF_SENSOR",
    "USUAL_SENSOR",
    "MessageType",
    "PackageRequest",
    "PackageSpec",
    "RobotJoints",
    "check_request",
]

USUAL_CTRL = "PositionSetpoint"
USUAL_EST = "EstimatedState"
USUAL_SENSOR = "JointEncoders"
USUAL_CPP_SENSOR = "ObkJointEncoders"
"""The message packages used with the C++ library have no `JointEncoders`."""
USUAL_OF_SENSOR = "ObkImu"
"""Message type of `sensor` nodes."""

_CLASSES_IN_USE = (
    "Iterator",
    "LifecycleState",
    "ObeliskController",
    "ObeliskEstimator",
    "ObeliskRobot",
    "ObeliskSensor",
    "TransitionCallbackReturn",
)


class Messages(Protocol):
    """The message packages in which types are looked up."""

    def message_names(self, package: str) -> tuple[str, ...] | None:
        """The messages of a package; None if the package does not exist."""

    def message_definition(self, package: str, name: str) -> str | None:
        """The text that defines a message."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageType:
    """A ROS message type by its two names."""

    package: str
    name: str
    definition: str | None = field(default=None, repr=False, compare=False)
    """Its definition, for the user's own types."""

    @property
    def full(self) -> str:
        """`pkg/msg/Name`."""
        return f"{self.package}/msg/{self.name}"

    @property
    def module(self) -> str:
        """The Python module that contains the class."""
        return f"{self.package}.msg"

    @property
    def spelling(self) -> str:
        """The name in a config: bare if that identifies the type, otherwise with its package."""
        return self.name if resolve_msg_type(self.name) == self.full else self.full


@dataclass(frozen=True, slots=True, kw_only=True)
class PackageRequest:
    """A package as requested on the command line; a message type of None is undecided."""

    kind: Kind
    name: str
    language: Language = "py"
    release: Release = "2026"
    ctrl_msg: str | None = None
    est_msg: str | None = None
    sensor_msg: str | None = None
    with_service: bool = False
    controls: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotJoints:
    """The joints of a robot; by default one, whose control is its position."""

    start: Mapping[str, float] = field(default_factory=lambda: {"joint": 0.0})
    """Joint -> position before the first command [rad or m], in the order of the encoders."""
    driven: tuple[str, ...] = ("joint",)
    """The joint of each actuator; empty if an actuator drives something else."""
    are_servos: bool = True
    """Whether each value of `u_mujoco` is the position of a joint."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PackageSpec:
    """The package to create; all of its names are checked."""

    kind: Kind
    package: str
    node: str
    ctrl: MessageType
    est: MessageType
    sensor: MessageType
    language: Language = "py"
    release: Release = "2026"
    """Version of the library for a C++ node."""
    with_service: bool = False
    """Whether a message package also contains a service."""
    controls: int = 1
    """Number of values in a control message for the simulator."""
    joints: RobotJoints = field(default_factory=RobotJoints)
    """For a robot."""

    @property
    def class_name(self) -> str:
        """The node's class: `foo` and `foo_controller` both give `FooController`."""
        words = self.node.removesuffix(f"_{self.kind}").split("_")
        return "".join(word.capitalize() for word in (*words, self.kind))

    @property
    def messages(self) -> tuple[MessageType, ...]:
        """The message types that this kind of node uses."""
        by_kind: dict[Kind, tuple[MessageType, ...]] = {
            "controller": (self.ctrl, self.est),
            "estimator": (self.est, self.sensor),
            "robot": (self.ctrl, self.sensor),
            "sensor": (self.sensor,),
        }
        return by_kind.get(self.kind, ())

    def in_package(self, package: str) -> "PackageSpec":
        """The same node in a package with another name."""
        return replace(self, package=package)


def check_request(
    request: PackageRequest,
    *,
    owner_of: Callable[[str], str | None],
    messages: Messages | None = None,
) -> PackageSpec | tuple[Problem, ...]:
    """Check the request; the node goes into a new package with its own name.

    `owner_of` returns the owner of a top-level module name, or None if it is free. `messages` looks
    up existing packages; a missing package may be created later.
    """
    language = _check_language(request)
    name = check_name(request.name, kind=request.kind, owner_of=owner_of)
    ctrl = _check_message("--ctrl-msg", request.ctrl_msg or USUAL_CTRL, messages)
    est = _check_message("--est-msg", request.est_msg or USUAL_EST, messages)
    usual_sensor = USUAL_CPP_SENSOR if request.language == "cpp" else USUAL_SENSOR
    if request.kind == "sensor":
        usual_sensor = USUAL_OF_SENSOR
    sensor = _check_message("--sensor-msg", request.sensor_msg or usual_sensor, messages)
    if (
        language is None
        and name is None
        and isinstance(ctrl, MessageType)
        and isinstance(est, MessageType)
        and isinstance(sensor, MessageType)
    ):
        spec = PackageSpec(
            kind=request.kind,
            package=request.name,
            node=request.name,
            ctrl=ctrl,
            est=est,
            sensor=sensor,
            language=request.language,
            release=request.release,
            with_service=request.with_service,
            controls=request.controls,
        )
        return _check_clashes(spec) or spec
    return tuple(p for p in (language, name, ctrl, est, sensor) if isinstance(p, Problem))


def _check_language(request: PackageRequest) -> Problem | None:
    if recipe_of(request.kind, request.language) is not None:
        return None
    return Problem(
        sentence=f"--lang: a {request.kind} cannot be created in `{request.language}`",
        help="omit --lang; only controllers and estimators can be created in `cpp`",
    )


def _check_message(option: str, written: str, messages: Messages | None) -> MessageType | Problem:
    full = resolve_msg_type(written)
    if full is not None:
        package, _, name = full.partition("/msg/")
        is_usual = package in OBELISK_MESSAGES or name in ROS_MESSAGES.get(package, ())
        names = None if is_usual or messages is None else messages.message_names(package)
        if names is None or messages is None:
            return MessageType(package=package, name=name)
        if name in names:
            definition = messages.message_definition(package, name)
            return MessageType(package=package, name=name, definition=definition)
        near_own = ask_for(f"{package}/{one}" for one in near_names(name, names))
        available = (
            f"available: {list_names(names)}" if names else "it does not define any messages"
        )
        return Problem(
            sentence=f"{option}: package `{package}` has no message `{name}`",
            help=near_own or available,
        )
    near = ask_for(near_msg_types(written))
    return Problem(
        sentence=f"{option}: unknown message type `{written}`",
        help=f"{near} Write your own type as pkg/msg/Name."
        if near
        else "write your own type as pkg/msg/Name",
    )


def _check_clashes(spec: PackageSpec) -> tuple[Problem, ...]:
    """Report class names that would clash in the node's module."""
    twice = tuple(
        Problem(
            sentence=f"`{one.full}` and `{other.full}` have the same class name `{one.name}`",
            help="choose message types with different class names",
        )
        for one, other in combinations(spec.messages, 2)
        if one.name == other.name and one != other
    )
    own = {spec.class_name, *_CLASSES_IN_USE} if spec.kind in NODE_KINDS else set()
    return twice + tuple(
        Problem(
            sentence=f"`{message.full}` has the name of a class that the node's module needs",
            help="choose another name for the node, or another message type",
        )
        for message in spec.messages
        if message.name in own
    )
