"""Facts about a MuJoCo model for the checks; does not import MuJoCo.

`read_model_facts` takes a `mujoco.MjSpec` that the caller has loaded. It compiles nothing and opens
no meshes, so a model can be checked even if its meshes are missing.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

__all__ = ["ActuatorFact", "ModelFacts", "SensorFact", "read_model_facts"]

_SENSOR_TAGS = {"geomdist": "distance", "geomnormal": "normal", "geomfromto": "fromto"}
"""Sensor types whose MJCF tag differs from the lower-case enum name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorFact:
    """A named sensor of the model."""

    name: str
    type: str
    """The MJCF tag: `jointpos`, `framequat`."""
    object_type: str
    """Type of the object that it is attached to: `joint`, `site`, `body`."""
    object_name: str
    joint_type: str | None = None
    """`hinge`, `slide`, `ball` or `free` for a sensor of a joint, otherwise None."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorFact:
    """An actuator of the model."""

    name: str
    """Its own name, otherwise that of the joint that only it drives; may be empty."""
    unit: str
    """Unit of its control, such as `N m`; empty if the model does not determine one."""
    joint: str = ""
    """The joint that it drives; empty if it drives something else."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelFacts:
    """Facts about a model; mappings are keyed by name, in the order of the model."""

    sensors: Mapping[str, SensorFact] = field(default_factory=dict)
    joints: Mapping[str, str] = field(default_factory=dict)
    """Name -> type."""
    geoms: Mapping[str, str] = field(default_factory=dict)
    """Name -> type, `box`, `sphere`."""
    bodies: tuple[str, ...] = ()
    sites: tuple[str, ...] = ()
    cameras: tuple[str, ...] = ()
    keyframes: tuple[str, ...] = ()
    poses: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Keyframe -> hinge or slide -> position [rad or m]; the key `""` is the initial state."""
    actuators: tuple[ActuatorFact, ...] = ()
    """In the order of the controls."""
    position_servos: int = 0
    """Number of actuators whose control is a position."""
    timestep: float = 0.002
    """[s]"""


def read_model_facts(spec: Any) -> ModelFacts:
    """Collect the facts about a loaded `mujoco.MjSpec`."""
    joints = {joint.name: _enum_word(joint.type) for joint in spec.joints if joint.name}
    sensors = (_read_sensor(sensor, joints) for sensor in spec.sensors if sensor.name)
    return ModelFacts(
        sensors={sensor.name: sensor for sensor in sensors},
        joints=joints,
        geoms={geom.name: _enum_word(geom.type) for geom in spec.geoms if geom.name},
        bodies=_names(spec.bodies),
        sites=_names(spec.sites),
        cameras=_names(spec.cameras),
        keyframes=_names(spec.keys),
        poses=_read_poses(spec),
        actuators=tuple(_read_actuators(spec.actuators, joints)),
        position_servos=sum(map(_is_position_servo, spec.actuators)),
        timestep=float(spec.option.timestep),
    )


def _read_sensor(sensor: Any, joints: Mapping[str, str]) -> SensorFact:
    word = _enum_word(sensor.type)
    return SensorFact(
        name=sensor.name,
        type=_SENSOR_TAGS.get(word, word),
        object_type=_enum_word(sensor.objtype),
        object_name=sensor.objname,
        joint_type=joints.get(sensor.objname) if _enum_word(sensor.objtype) == "joint" else None,
    )


_COORDINATES: Final = {"free": 7, "ball": 4, "hinge": 1, "slide": 1}
"""Joint type -> its number of values in `qpos`."""


def _read_poses(spec: Any) -> dict[str, dict[str, float]]:
    addresses: dict[str, int] = {}
    initial: dict[str, float] = {}
    address = 0
    for joint in _joints(spec.worldbody):
        kind = _enum_word(joint.type)
        if joint.name and _COORDINATES[kind] == 1:
            is_in_degrees = kind == "hinge" and spec.compiler.degree
            addresses[joint.name] = address
            initial[joint.name] = float(math.radians(joint.ref) if is_in_degrees else joint.ref)
        address += _COORDINATES[kind]
    poses = {"": initial}
    for key in spec.keys:
        # A keyframe without `qpos` has the initial positions; one of another length is an error.
        if key.name and len(key.qpos) in (0, address):
            given = addresses if len(key.qpos) else {}
            poses[key.name] = initial | {name: float(key.qpos[at]) for name, at in given.items()}
    return poses


def _joints(world: Any) -> Iterator[Any]:
    """All joints, in the order of `qpos`; a chain of bodies may be too long for a recursion."""
    waiting = [world]
    while waiting:
        body = waiting.pop()
        yield from body.joints
        waiting += reversed(body.bodies)


_FORCE, _POSITION, _VELOCITY = 0, 1, 2
_UNITS: Final = {"hinge": ("N m", "rad", "rad/s"), "slide": ("N", "m", "m/s")}
"""Joint type -> units of a force, a position and a velocity."""


def _read_actuators(actuators: Sequence[Any], joints: Mapping[str, str]) -> Iterator[ActuatorFact]:
    driven = [one.target if _drives_a_joint(one) else "" for one in actuators]
    for actuator, joint in zip(actuators, driven, strict=True):
        units, quantity = _UNITS.get(joints.get(joint, "")), _quantity(actuator)
        # With a gear, the control is that of the motor, or scaled to another range.
        has_gear = actuator.gear[0] != 1.0
        yield ActuatorFact(
            name=actuator.name or (joint if driven.count(joint) == 1 else ""),
            unit="" if units is None or quantity is None or has_gear else units[quantity],
            joint=joint,
        )


def _drives_a_joint(actuator: Any) -> bool:
    return _enum_word(actuator.trntype) in ("joint", "jointinparent")


def _quantity(actuator: Any) -> int | None:
    """The quantity of a control: force = gain * ctrl + b0 + b1 * length + b2 * velocity."""
    if _enum_word(actuator.dyntype) not in ("none", "filter", "filterexact"):
        return None
    if _enum_word(actuator.gaintype) != "fixed":
        return None
    gain, bias = actuator.gainprm[0], actuator.biasprm
    match _enum_word(actuator.biastype):
        case "none":
            return _FORCE if gain == 1.0 else None
        case "affine" if bias[1]:
            return _POSITION if gain == -bias[1] and not bias[0] else None
        case "affine" if bias[2]:
            return _VELOCITY if gain == -bias[2] and not bias[0] else None
    return None


def _is_position_servo(actuator: Any) -> bool:
    """Whether the force is affine: gain * ctrl + b0 + b1 * length + b2 * velocity."""
    kinds = _enum_word(actuator.gaintype), _enum_word(actuator.biastype)
    return kinds == ("fixed", "affine") and bool(actuator.biasprm[1])


def _enum_word(member: Any) -> str:
    """`mjSENS_JOINTPOS` -> `jointpos`."""
    return str(member.name).partition("_")[2].lower()


def _names(elements: Iterable[Any]) -> tuple[str, ...]:
    return tuple(element.name for element in elements if element.name)
