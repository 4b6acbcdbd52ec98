"""Check ROS names, and resolve message types from the names in a config.

Each `*_fault` function returns why a name is invalid, or None if it is valid. A bare message name
(`PositionSetpoint`) is looked up among the Obelisk messages, then among the common ROS messages.
`pkg/Name` and `pkg/msg/Name` are used as written. No message is imported.

`JointEncoders` is the original sensor message; its only field `y` holds joint positions, then
velocities. The language page also calls it an alias of the sensor group `ObkJointEncoders`. As a
sensor group it reads the same MuJoCo sensors, but publishes `JointEncoders`, the message to which
an original estimator subscribes.

Source: ROS 2 design, "Topic and Service name mapping"; rmw/validate_*.h; REP 144.
"""

import re
from collections.abc import Mapping
from types import MappingProxyType

from obelisk_spec.suggestions import near_names, sure_name

__all__ = [
    "OBELISK_MESSAGES",
    "ROS_MESSAGES",
    "bare_name",
    "namespace_fault",
    "near_msg_types",
    "node_name_fault",
    "package_name_fault",
    "resolve_msg_type",
    "sure_msg_type",
    "topic_name_fault",
]

_LONGEST_NODE_NAME = 255
_LONGEST_TOPIC_NAME = 247
_LONGEST_NAMESPACE = 245


def topic_name_fault(name: str) -> str | None:
    """Why `name` is not a valid topic name: relative, absolute or private (`~/x`)."""
    if not name:
        return "it is empty"
    if name != "~" and name.startswith("~") and not name.startswith("~/"):
        return "`~` must be followed by `/`"
    if len(name) > _LONGEST_TOPIC_NAME:
        return f"it is longer than {_LONGEST_TOPIC_NAME} characters"
    body = name.removeprefix("~")
    if "~" in body:
        return "`~` is only allowed at the start"
    return _path_fault(body)


def namespace_fault(name: str) -> str | None:
    """Why `name` is not a valid namespace, with or without its leading `/`."""
    if not name:
        return "it is empty"
    if len(name) > _LONGEST_NAMESPACE:
        return f"it is longer than {_LONGEST_NAMESPACE} characters"
    return None if name == "/" else _path_fault(name)


def node_name_fault(name: str) -> str | None:
    """Why `name` is not a valid node name."""
    if not name:
        return "it is empty"
    if len(name) > _LONGEST_NODE_NAME:
        return f"it is longer than {_LONGEST_NODE_NAME} characters"
    return _token_fault(name)


def package_name_fault(name: str) -> str | None:
    """Why `name` is not a valid ROS package name."""
    if re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]+", name):
        return None
    if len(name) < 2:
        return "it needs at least two characters"
    if not name[0].isascii() or not name[0].isalpha():
        return "it must start with a letter"
    return "it may contain only letters, digits, `_` and `-`"


def _path_fault(path: str) -> str | None:
    if path.endswith("/"):
        return "it ends with `/`"
    if "//" in path:
        return "it contains `//`"
    tokens = path.removeprefix("/").split("/")
    return next((fault for fault in map(_token_fault, tokens) if fault), None)


def _token_fault(token: str) -> str | None:
    wrong = re.search(r"[^A-Za-z0-9_]", token)
    if wrong:
        return f"{wrong[0]!r} is not a letter, digit or `_`"
    return f"`{token}` starts with a digit" if token[:1].isdigit() else None


OBELISK_MESSAGES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "obelisk_control_msgs": (
            "PositionSetpoint",
            "PDFeedForward",
            "VelocityCommand",
            "ExecutionFSM",
        ),
        "obelisk_estimator_msgs": ("EstimatedState",),
        "obelisk_sensor_msgs": (
            "JointEncoders",
            "ObkJointEncoders",
            "ObkImu",
            "ObkFramePose",
            "ObkForceSensor",
            "ObkScan",
            "ObkImage",
            "TrueSimState",
        ),
        "obelisk_std_msgs": ("FloatMultiArray", "UInt8MultiArray"),
    }
)
"""Package -> its messages. The lists are complete: no other message exists in these packages.

The bare name UInt8MultiArray means the Obelisk message, although std_msgs also has one.
"""

ROS_MESSAGES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "std_msgs": tuple(
            "Bool Byte ByteMultiArray Char ColorRGBA Empty Float32 Float32MultiArray Float64 "
            "Float64MultiArray Header Int16 Int16MultiArray Int32 Int32MultiArray Int64 "
            "Int64MultiArray Int8 Int8MultiArray MultiArrayDimension MultiArrayLayout String "
            "UInt16 UInt16MultiArray UInt32 UInt32MultiArray UInt64 UInt64MultiArray UInt8 "
            "UInt8MultiArray".split()
        ),
        "geometry_msgs": tuple(
            "Accel AccelStamped AccelWithCovariance AccelWithCovarianceStamped Inertia "
            "InertiaStamped Point Point32 PointStamped Polygon PolygonStamped Pose Pose2D "
            "PoseArray PoseStamped PoseWithCovariance PoseWithCovarianceStamped Quaternion "
            "QuaternionStamped Transform TransformStamped Twist TwistStamped TwistWithCovariance "
            "TwistWithCovarianceStamped Vector3 Vector3Stamped Wrench WrenchStamped".split()
        ),
        "sensor_msgs": tuple(
            "BatteryState CameraInfo CompressedImage FluidPressure Illuminance Image Imu "
            "JointState Joy JoyFeedback JoyFeedbackArray LaserScan MagneticField "
            "MultiDOFJointState NavSatFix PointCloud PointCloud2 Range RegionOfInterest "
            "RelativeHumidity Temperature TimeReference".split()
        ),
        "nav_msgs": ("GridCells", "MapMetaData", "OccupancyGrid", "Odometry", "Path"),
        "visualization_msgs": (
            "ImageMarker",
            "InteractiveMarker",
            "Marker",
            "MarkerArray",
        ),
        "trajectory_msgs": (
            "JointTrajectory",
            "JointTrajectoryPoint",
            "MultiDOFJointTrajectory",
            "MultiDOFJointTrajectoryPoint",
        ),
        "diagnostic_msgs": ("DiagnosticArray", "DiagnosticStatus", "KeyValue"),
        "tf2_msgs": ("TFMessage",),
        "rosgraph_msgs": ("Clock",),
    }
)
"""Package -> the messages that may be named bare; the packages contain further messages."""

_WRITTEN_IN_FULL = re.compile(r"([a-z][a-z0-9_]*)/(?:msg/)?([A-Z][A-Za-z0-9]*)")


def _bare_names() -> Mapping[str, str]:
    """Bare name -> full name; Obelisk messages take precedence over ROS ones."""
    both = {**ROS_MESSAGES, **OBELISK_MESSAGES}
    return MappingProxyType(
        {name: f"{package}/msg/{name}" for package, names in both.items() for name in names}
    )


_FULL_BY_BARE = _bare_names()


def resolve_msg_type(name: str) -> str | None:
    """Return the full name `pkg/msg/Name` of a message type; None if it does not exist.

    Types in packages other than Obelisk's are not checked, because users have their own packages.
    """
    if "/" not in name:
        return _FULL_BY_BARE.get(name)
    parts = _WRITTEN_IN_FULL.fullmatch(name)
    if parts is None:
        return None
    package, message = parts.groups()
    if package in OBELISK_MESSAGES and message not in OBELISK_MESSAGES[package]:
        return None
    return f"{package}/msg/{message}"


def near_msg_types(name: str) -> tuple[str, ...]:
    """Return at most three bare names of messages similar to `name`, best first."""
    return near_names(bare_name(name), _FULL_BY_BARE)


def sure_msg_type(name: str) -> str | None:
    """Return the only message that a bare `name` can be a typo of; None if ambiguous."""
    return sure_name(name, _FULL_BY_BARE)


def bare_name(msg_type: str) -> str:
    """Return the last part of a message type: `sensor_msgs/msg/Imu` -> `Imu`."""
    return msg_type.rpartition("/")[2]
