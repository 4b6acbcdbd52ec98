"""The sensor groups of a `sim` block: what each `msg_type` takes and what it publishes.

Data and look-ups only. A group written `JointEncoders` publishes the seeds' message of that name,
see `obelisk_spec.messages`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

from obelisk_spec.messages import bare_name

__all__ = [
    "RAY_PATTERNS",
    "SENSOR_GROUPS",
    "GroupRule",
    "ObjectRule",
    "SensorUse",
    "sensor_group",
]

ObjectRule = Literal["scalar joint", "one site", "one object"]
"""Where the sensors of a group must sit: on hinge or slide joints, all at one site, or all on one
object of any kind."""

RAY_PATTERNS: Final = ("height_scan", "lidar_scan", "depth_camera")


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorUse:
    """How a group uses one MuJoCo sensor type."""

    at_most: int | None = None
    """None: any number."""
    presence: Literal["optional", "expected", "required"] = "optional"
    """Whether a group without it is fine, works with less to say, or cannot work."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupRule:
    """One `msg_type` of a sensor group."""

    published: str
    """Full message type."""
    takes: Mapping[str, SensorUse]
    """MuJoCo sensor type, or `camera` -> how it is used; empty for groups that read none."""
    objects: ObjectRule | None = None
    patterns: tuple[str, ...] = ()
    """Ray caster patterns that it can carry; empty for groups that cast no rays."""

    @property
    def reads_sensors(self) -> bool:
        """Whether `sensor_names` decides what is published."""
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
"""`msg_type` as written, bare -> its rule. GridCells is met in field configs."""


def sensor_group(msg_type: str) -> GroupRule | None:
    """The rule of a group's `msg_type`, bare or with its package; None if there is none."""
    bare = bare_name(msg_type)
    rule = SENSOR_GROUPS.get(bare)
    if rule is None or "/" not in msg_type or bare == "DepthImage":
        return rule
    package = msg_type.partition("/")[0]
    return rule if rule.published.startswith(f"{package}/") else None
