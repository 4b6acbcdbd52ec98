"""Look up what each sensor group of a `sim` block reads and publishes, and check its noise.

The tables are `SENSOR_GROUPS` and `NOISY_FIELDS`. `check_noise` checks the noise and delay of a
group. A group with the type `JointEncoders` publishes the original message with this name; see
`obelisk_spec.names`.
"""

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Literal

from obelisk_spec.names import bare_name
from obelisk_spec.sim_block import SimFault, SimPath
from obelisk_spec.suggestions import did_you_mean, list_names, sure_name, with_article
from obelisk_spec.values import is_mapping, is_number

__all__ = [
    "FIELD_NOISE_KEYS",
    "NOISY_FIELDS",
    "RAY_PATTERNS",
    "SENSOR_GROUPS",
    "FieldKind",
    "GroupRule",
    "check_noise",
    "sensor_group",
]

ObjectRule = Literal["scalar joint", "one site", "one object"]
"""Where the sensors of a group must be: on hinge or slide joints, all at one site, or all on one
object of any kind."""

RAY_PATTERNS: Final = ("height_scan", "lidar_scan", "depth_camera")


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorUse:
    """How a group uses one MuJoCo sensor type."""

    at_most: int | None = None
    """Maximum number of sensors; None for any number."""
    presence: Literal["optional", "expected", "required"] = "optional"
    """Without it, a group is complete, leaves a part of its message empty, or is invalid."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupRule:
    """What a sensor group with a given `msg_type` reads and publishes."""

    published: str
    """Full message type."""
    takes: Mapping[str, SensorUse]
    """MuJoCo sensor type, or `camera` -> its use; empty if the group reads no sensors."""
    objects: ObjectRule | None = None
    patterns: tuple[str, ...] = ()
    """Ray patterns that the message supports; empty if the group casts no rays."""

    @property
    def reads_sensors(self) -> bool:
        """Whether `sensor_names` determines what is published."""
        return bool(self.takes)


_ANY = SensorUse()
_ONE_REQUIRED = SensorUse(at_most=1, presence="required")
_ONE_EXPECTED = SensorUse(at_most=1, presence="expected")

_ENCODERS = {"jointpos": _ANY, "jointvel": _ANY}
_IMU = {"accelerometer": _ONE_EXPECTED, "gyro": _ONE_EXPECTED, "framequat": _ONE_EXPECTED}
_POSE = {"framepos": _ONE_REQUIRED, "framequat": _ONE_REQUIRED}
_ODOMETRY = {
    "framepos": _ONE_EXPECTED,
    "framequat": _ONE_EXPECTED,
    "velocimeter": _ONE_EXPECTED,
    "gyro": _ONE_EXPECTED,
}

SENSOR_GROUPS: Mapping[str, GroupRule] = MappingProxyType(
    {
        "ObkJointEncoders": GroupRule(
            published="obelisk_sensor_msgs/msg/ObkJointEncoders",
            takes=_ENCODERS,
            objects="scalar joint",
        ),
        "JointEncoders": GroupRule(
            published="obelisk_sensor_msgs/msg/JointEncoders",
            takes=_ENCODERS,
            objects="scalar joint",
        ),
        "ObkImu": GroupRule(
            published="obelisk_sensor_msgs/msg/ObkImu", takes=_IMU, objects="one site"
        ),
        "Imu": GroupRule(published="sensor_msgs/msg/Imu", takes=_IMU, objects="one site"),
        "ObkFramePose": GroupRule(
            published="obelisk_sensor_msgs/msg/ObkFramePose", takes=_POSE, objects="one object"
        ),
        "PoseStamped": GroupRule(
            published="geometry_msgs/msg/PoseStamped", takes=_POSE, objects="one object"
        ),
        "Odometry": GroupRule(published="nav_msgs/msg/Odometry", takes=_ODOMETRY),
        "ObkForceSensor": GroupRule(
            published="obelisk_sensor_msgs/msg/ObkForceSensor",
            takes={"force": _ANY, "touch": _ANY},
        ),
        "ObkScan": GroupRule(
            published="obelisk_sensor_msgs/msg/ObkScan",
            takes={},
            patterns=("height_scan", "lidar_scan"),
        ),
        "PointCloud2": GroupRule(
            published="sensor_msgs/msg/PointCloud2",
            takes={},
            patterns=("height_scan", "lidar_scan"),
        ),
        "DepthImage": GroupRule(
            published="sensor_msgs/msg/Image", takes={}, patterns=("depth_camera", "lidar_scan")
        ),
        "ObkImage": GroupRule(
            published="obelisk_sensor_msgs/msg/ObkImage", takes={"camera": _ONE_REQUIRED}
        ),
        "GridCells": GroupRule(published="nav_msgs/msg/GridCells", takes={}),
    }
)
"""Bare `msg_type` in a config -> its rule. Existing configs contain GridCells."""


def sensor_group(msg_type: str) -> GroupRule | None:
    """Return the rule for a `msg_type`, bare or with its package; None if there is none."""
    bare = bare_name(msg_type)
    rule = SENSOR_GROUPS.get(bare)
    if rule is None or "/" not in msg_type or bare == "DepthImage":
        return rule
    package = msg_type.partition("/")[0]
    return rule if rule.published.startswith(f"{package}/") else None


FieldKind = Literal["vector", "rotation", "array", "points"]
"""Three numbers; an orientation, whose noise is a rotation about its three axes [rad]; an array of
any length; the coordinates of any number of points."""

FIELD_NOISE_KEYS: Final = ("sigma", "bias")
_AXES: Final = 3

_ENCODERS_FIELDS: Final[Mapping[str, FieldKind]] = {"joint_pos": "array", "joint_vel": "array"}
_IMU_FIELDS: Final[Mapping[str, FieldKind]] = {
    "linear_acceleration": "vector",
    "angular_velocity": "vector",
    "orientation": "rotation",
}
_POSE_FIELDS: Final[Mapping[str, FieldKind]] = {"position": "vector", "orientation": "rotation"}
_DATA_FIELDS: Final[Mapping[str, FieldKind]] = {"data": "array"}

NOISY_FIELDS: Mapping[str, Mapping[str, FieldKind]] = MappingProxyType(
    {
        "ObkJointEncoders": _ENCODERS_FIELDS,
        "JointEncoders": {"y": "array"},
        "ObkImu": _IMU_FIELDS,
        "Imu": _IMU_FIELDS,
        "ObkFramePose": _POSE_FIELDS,
        "PoseStamped": _POSE_FIELDS,
        "Odometry": {**_POSE_FIELDS, "linear": "vector", "angular": "vector"},
        "ObkForceSensor": {"forces": "array"},
        "ObkScan": _DATA_FIELDS,
        "PointCloud2": {"data": "points"},
        "DepthImage": _DATA_FIELDS,
    }
)
"""Bare `msg_type` of a sensor group -> its fields that can have noise."""

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
"""Noisy field -> the sensor type that sets it; any sensor of the group may set other fields."""

_UNDELAYED: Final = frozenset({"ObkImage"})
"""Groups that publish a message as soon as it is ready, at any simulated time."""


def check_noise(
    group: Mapping[str, Any], path: SimPath, *, is_incomplete: bool
) -> Iterator[SimFault]:
    """Yield findings about `noise` and `delay` of a group whose keys have the right types.

    `is_incomplete`: whether a sensor that seems to be missing may just have the wrong type.
    """
    written = str(group["msg_type"])
    fields = NOISY_FIELDS.get(bare_name(written), {})
    for name, noise in (group.get("noise") or {}).items():
        place = (*path, "noise", name)
        if name in fields:
            yield from _check_field(name, noise, fields[name], place)
            if not is_incomplete:
                yield from _check_measured(name, group, place)
            continue
        yield SimFault(
            code="OBK101",
            severity="error",
            path=place,
            points_at="key",
            message=f"`{written}` has no field `{name}` that can have noise",
            help=did_you_mean(name, fields) if fields else "none of its fields can have noise",
            meant=sure_name(name, fields),
        )
    delay = group.get("delay")
    if delay and bare_name(written) in _UNDELAYED:
        yield SimFault(
            code="OBK103",
            severity="error",
            path=(*path, "delay"),
            message=f"`delay` is {delay:g}, but {with_article(written)} cannot be delayed: "
            "it is published when it is rendered",
        )


def _check_measured(name: str, group: Mapping[str, Any], path: SimPath) -> Iterator[SimFault]:
    """Require the sensor that sets the field; otherwise noise accumulates from sample to sample."""
    sensor_type = _MEASURED_BY.get(name)
    if sensor_type is None or sensor_type in (group.get("sensor_names") or {}).values():
        return
    yield SimFault(
        code="OBK306",
        severity="error",
        path=path,
        points_at="key",
        message=f"the noise of `{name}` needs {with_article(sensor_type)} sensor, but the group "
        "has none",
        help="add the sensor, or remove the noise",
    )


def _check_field(name: str, noise: object, kind: FieldKind, path: SimPath) -> Iterator[SimFault]:
    if not is_mapping(noise):
        yield _invalid(f"the noise of `{name}` is {noise!r}", _expected_keys(), path)
        return
    for key in noise:
        if key not in FIELD_NOISE_KEYS:
            yield SimFault(
                code="OBK101",
                severity="error",
                path=(*path, key),
                points_at="key",
                message=f"`{key}` is not a valid key of the noise of `{name}`",
                help=did_you_mean(key, FIELD_NOISE_KEYS),
                meant=sure_name(key, FIELD_NOISE_KEYS),
            )
    for key in FIELD_NOISE_KEYS:
        value = noise.get(key)
        if value is None:
            continue
        least = 0.0 if key == "sigma" else -sys.float_info.max
        if not _is_amount(value, kind, least):
            yield _invalid(f"`{key}` is {value!r}", _expected(kind, key), (*path, key))


def _is_amount(value: object, kind: FieldKind, least: float) -> bool:
    if isinstance(value, list | tuple):
        return (
            kind in ("vector", "rotation")
            and len(value) == _AXES
            and all(is_number(each, least) for each in value)
        )
    return is_number(value, least)


def _expected_keys() -> str:
    return f"a mapping with {list_names(FIELD_NOISE_KEYS)}"


def _expected(kind: FieldKind, key: str) -> str:
    one = "a number of at least 0" if key == "sigma" else "a number"
    return one if kind in ("array", "points") else f"{one}, or three of them"


def _invalid(what: str, expected: str, path: SimPath) -> SimFault:
    return SimFault(
        code="OBK103", severity="error", path=path, message=f"{what}, expected {expected}"
    )
