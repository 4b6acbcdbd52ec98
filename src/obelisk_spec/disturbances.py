"""What keeps a simulated sensor from being perfect: noise, dropout and delay of a sensor group.

Pure; takes a group as plain values, gives findings with the path into the sim block.
"""

import sys
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, Final, Literal

from obelisk_spec.messages import bare_name
from obelisk_spec.sim_faults import SimFault, SimPath
from obelisk_spec.suggestions import did_you_mean, list_names, sure_name
from obelisk_spec.values import is_mapping, is_number
from obelisk_spec.wording import with_article

__all__ = ["FIELD_NOISE_KEYS", "NOISY_FIELDS", "FieldKind", "check_disturbances"]

FieldKind = Literal["vector", "rotation", "array"]
"""Three numbers; an orientation, whose noise is a turn about its three axes [rad]; any number of
numbers."""

FIELD_NOISE_KEYS: Final = ("sigma", "bias")
_AXES: Final = 3

_ENCODERS: Final[Mapping[str, FieldKind]] = {"joint_pos": "array", "joint_vel": "array"}
_IMU: Final[Mapping[str, FieldKind]] = {
    "linear_acceleration": "vector",
    "angular_velocity": "vector",
    "orientation": "rotation",
}
_POSE: Final[Mapping[str, FieldKind]] = {"position": "vector", "orientation": "rotation"}
_DATA: Final[Mapping[str, FieldKind]] = {"data": "array"}

NOISY_FIELDS: Mapping[str, Mapping[str, FieldKind]] = MappingProxyType(
    {
        "ObkJointEncoders": _ENCODERS,
        "JointEncoders": {"y": "array"},
        "ObkImu": _IMU,
        "Imu": _IMU,
        "ObkFramePose": _POSE,
        "PoseStamped": _POSE,
        "Odometry": {**_POSE, "linear": "vector", "angular": "vector"},
        "ObkForceSensor": {"forces": "array"},
        "ObkScan": _DATA,
        "PointCloud2": _DATA,
        "DepthImage": _DATA,
    }
)
"""Bare `msg_type` of a sensor group -> its fields that noise can be added to."""

_MEASURED_BY: Final[Mapping[str, str]] = {
    "joint_pos": "jointpos",
    "joint_vel": "jointvel",
    "linear_acceleration": "accelerometer",
    "angular_velocity": "gyro",
    "orientation": "framequat",
    "position": "framepos",
    "linear": "velocimeter",
    "angular": "gyro",
}
"""Noisy field -> the sensor type that it takes its numbers from; of others any of the group's."""

_UNDELAYED: Final = frozenset({"ObkImage"})
"""Groups whose messages come when they are ready, whatever the simulation time is by then."""


def check_disturbances(
    group: Mapping[str, Any], path: SimPath, *, has_lost: bool
) -> Iterator[SimFault]:
    """Findings about `noise` and `delay` of a group that has the shape of one.

    `has_lost`: a sensor that seems to be missing may be one whose type is written wrong.
    """
    written = str(group["msg_type"])
    fields = NOISY_FIELDS.get(bare_name(written), {})
    for name, noise in (group.get("noise") or {}).items():
        place = (*path, "noise", name)
        if name in fields:
            yield from _check_field(name, noise, fields[name], place)
            if not has_lost:
                yield from _check_measured(name, group, place)
            continue
        yield SimFault(
            code="OBK101",
            severity="error",
            path=place,
            points_at="key",
            message=f"`{written}` has no field `{name}` that noise can be added to",
            help=did_you_mean(name, fields) if fields else "to none of its fields",
            meant=sure_name(name, fields),
        )
    delay = group.get("delay")
    if delay and bare_name(written) in _UNDELAYED:
        yield SimFault(
            code="OBK103",
            severity="error",
            path=(*path, "delay"),
            message=f"`delay` is {delay:g}, and {with_article(written)} cannot be delayed: "
            "it is published when it is drawn",
        )


def _check_measured(name: str, group: Mapping[str, Any], path: SimPath) -> Iterator[SimFault]:
    """Noise would add up, sample by sample, in numbers that no sensor renews."""
    sensor_type = _MEASURED_BY.get(name)
    if sensor_type is None or sensor_type in (group.get("sensor_names") or {}).values():
        return
    yield SimFault(
        code="OBK306",
        severity="error",
        path=path,
        points_at="key",
        message=f"the noise of `{name}` is for {with_article(sensor_type)} sensor, and the group "
        "has none",
        help="name the sensor, or leave the noise out",
    )


def _check_field(name: str, noise: object, kind: FieldKind, path: SimPath) -> Iterator[SimFault]:
    if not is_mapping(noise):
        yield _wrong(f"the noise of `{name}` is {noise!r}", _wanted_keys(), path)
        return
    for key in noise:
        if key not in FIELD_NOISE_KEYS:
            yield SimFault(
                code="OBK101",
                severity="error",
                path=(*path, key),
                points_at="key",
                message=f"the noise of `{name}` has no key `{key}`",
                help=did_you_mean(key, FIELD_NOISE_KEYS),
                meant=sure_name(key, FIELD_NOISE_KEYS),
            )
    for key in FIELD_NOISE_KEYS:
        value = noise.get(key)
        if value is None:
            continue
        least = 0.0 if key == "sigma" else -sys.float_info.max
        if not _is_amount(value, kind, least):
            yield _wrong(f"`{key}` is {value!r}", _wanted(kind, key), (*path, key))


def _is_amount(value: object, kind: FieldKind, least: float) -> bool:
    if isinstance(value, list | tuple):
        return (
            kind != "array"
            and len(value) == _AXES
            and all(is_number(each, least) for each in value)
        )
    return is_number(value, least)


def _wanted_keys() -> str:
    return f"a mapping with {list_names(FIELD_NOISE_KEYS)}"


def _wanted(kind: FieldKind, key: str) -> str:
    one = "a number of at least 0" if key == "sigma" else "a number"
    return one if kind == "array" else f"{one}, or three of them"


def _wrong(what: str, wanted: str, path: SimPath) -> SimFault:
    return SimFault(
        code="OBK103", severity="error", path=path, message=f"{what}, expected {wanted}"
    )
