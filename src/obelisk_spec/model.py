"""Facts about a MuJoCo model for the checks; does not import MuJoCo.

`read_model_facts` takes a `mujoco.MjSpec` that the caller has loaded. It compiles nothing and opens
no meshes, so a model can be checked even if its meshes are missing.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["ModelFacts", "SensorFact", "read_model_facts"]

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
    actuators: int = 0
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
        actuators=len(spec.actuators),
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


def _is_position_servo(actuator: Any) -> bool:
    """Whether the force is affine: gain * ctrl + b0 + b1 * length + b2 * velocity."""
    kinds = _enum_word(actuator.gaintype), _enum_word(actuator.biastype)
    return kinds == ("fixed", "affine") and bool(actuator.biasprm[1])


def _enum_word(member: Any) -> str:
    """`mjSENS_JOINTPOS` -> `jointpos`."""
    return str(member.name).partition("_")[2].lower()


def _names(elements: Iterable[Any]) -> tuple[str, ...]:
    return tuple(element.name for element in elements if element.name)
