"""Message types by the names that a config writes.

A bare name (`PositionSetpoint`) is looked up among the Obelisk messages, then among the common
ROS ones; `pkg/Name` and `pkg/msg/Name` are taken as written. Never imports a message.

`JointEncoders` is the seeds' sensor message, whose one field `y` holds joint positions, then
velocities. The language page also calls it an alias of the sensor group `ObkJointEncoders`: as a
sensor group it takes the same MuJoCo sensors, but what is published is the message of the name
that was written, so the seeds' estimator, which subscribes to JointEncoders, is served.
"""

import re
from collections.abc import Mapping
from types import MappingProxyType

from obelisk_spec.suggestions import near_names, sure_name

__all__ = [
    "OBELISK_MESSAGES",
    "ROS_MESSAGES",
    "bare_name",
    "near_msg_types",
    "resolve_msg_type",
    "sure_msg_type",
]

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
"""Package -> its messages. The whole of these packages: another name in them does not exist.

The bare name UInt8MultiArray means the Obelisk message; std_msgs has one of that name too.
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
"""Package -> the messages that may be named bare; not all that the packages hold."""

_WRITTEN_IN_FULL = re.compile(r"([a-z][a-z0-9_]*)/(?:msg/)?([A-Z][A-Za-z0-9]*)")


def _bare_names() -> Mapping[str, str]:
    """Bare name -> full name, the Obelisk messages winning over the ROS ones."""
    both = {**ROS_MESSAGES, **OBELISK_MESSAGES}
    return MappingProxyType(
        {name: f"{package}/msg/{name}" for package, names in both.items() for name in names}
    )


_FULL_BY_BARE = _bare_names()


def resolve_msg_type(name: str) -> str | None:
    """The full `pkg/msg/Name` that a written message type means, None if there is no such type.

    A type of a package outside the Obelisk ones is not looked up: the user's own are fine.
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
    """Bare names of messages that exist and look like `name`, best first, at most three."""
    return near_names(bare_name(name), _FULL_BY_BARE)


def sure_msg_type(name: str) -> str | None:
    """The message that a bare `name` is a slip of the pen from, None where there is any doubt."""
    return sure_name(name, _FULL_BY_BARE)


def bare_name(msg_type: str) -> str:
    """The last part of a message type: `sensor_msgs/msg/Imu` -> `Imu`."""
    return msg_type.rpartition("/")[2]
