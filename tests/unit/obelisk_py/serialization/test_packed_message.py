"""Packed messages compared with rclpy's serialization, for all messages that nodes exchange."""

import importlib
import re
from pathlib import Path
from random import Random

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from obelisk_sensor_msgs.msg import ObkImu, ObkJointEncoders
from rcl_interfaces.msg import ParameterValue
from rclpy.serialization import deserialize_message, serialize_message
from rosidl_parser.definition import UnboundedWString
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Empty, Header, String
from visualization_msgs.msg import Marker, MarkerArray

from obelisk_py.core.exceptions import ObeliskMsgError
from obelisk_py.core.serialization.codec import PackedMessage

INTERFACES = Path(__file__).resolve().parents[4] / "interfaces"
OWN = sorted(f"{f.parents[1].name}/{f.stem}" for f in INTERFACES.glob("obelisk_*/msg/*.msg"))
OTHERS = [
    "builtin_interfaces/Duration",
    "geometry_msgs/PoseStamped",
    "geometry_msgs/PoseWithCovariance",
    "nav_msgs/Odometry",
    "rosgraph_msgs/Clock",
    "sensor_msgs/BatteryState",
    "sensor_msgs/Image",
    "sensor_msgs/Imu",
    "sensor_msgs/JointState",
    "sensor_msgs/PointCloud2",
    "sensor_msgs/Range",
    "std_msgs/Bool",
    "std_msgs/Byte",
    "std_msgs/Empty",
    "std_msgs/Float64",
    "std_msgs/Int16MultiArray",
    "std_msgs/Int64MultiArray",
    "std_msgs/Int8",
    "std_msgs/String",
    "trajectory_msgs/JointTrajectory",
    "visualization_msgs/InteractiveMarker",
    "visualization_msgs/MarkerArray",
]
CHARACTERS = "ab c_é€𝄞"


def _class(name):
    package, _, bare = name.partition("/")
    return getattr(importlib.import_module(f"{package}.msg"), bare)


def _message(name, random):
    """A message with random lengths, strings and numbers."""
    message = _class(name)
    fields = message.get_fields_and_field_types()
    return message(**{field: _value(kind, random) for field, kind in fields.items()})


def _value(kind, random):
    if array := re.fullmatch(r"(.+)\[(\d+)\]", kind):
        return [_value(array[1], random) for _ in range(int(array[2]))]
    if sequence := re.fullmatch(r"sequence<(.+)>", kind):
        return [_value(sequence[1], random) for _ in range(random.randrange(4))]
    if "/" in kind:
        return _message(kind, random)
    if kind == "string":
        return "".join(random.choices(CHARACTERS, k=random.randrange(6)))
    number = random.randrange(2 if kind == "boolean" else 100)
    kinds = {"boolean": bool, "float": float, "double": float, "octet": lambda n: bytes([n])}
    return kinds.get(kind, int)(number)


def _put(message, path, numbers):
    """Write numbers into a message with its setters; `markers.2.scale.x`."""
    *way, last = path.split(".")
    for name in way:
        message = message[int(name)] if name.isdigit() else getattr(message, name)
    old = getattr(message, last)
    if isinstance(old, bytes):
        setattr(message, last, bytes(numbers.tolist()))
    elif hasattr(old, "__len__"):
        setattr(message, last, numbers.tolist())
    else:
        setattr(message, last, numbers.tolist()[0])


def _assert_same(sent, message):
    """Every byte is equal to rclpy's output, except padding, which is undefined in rclpy."""
    written = serialize_message(message)
    assert deserialize_message(sent, type(message)) == message
    differ = [byte for byte, its in zip(sent, written, strict=False) if byte != its]
    assert len(sent) <= len(written)
    assert not any(differ)


@pytest.mark.parametrize("name", [*OWN, *OTHERS])
def test_a_packed_message_equals_the_output_of_rclpy(name):
    random = Random(name)
    for _ in range(20):
        message = _message(name, random)
        packed = PackedMessage(message)
        for field in packed.fields:
            view = packed.numbers(field)
            assert view.flags.aligned
            view[:] = [random.randrange(2 if view.dtype == bool else 100) for _ in view]
            _put(message, field, view)
        _stamp(message, Time(sec=7, nanosec=89))
        _assert_same(packed.to_bytes(7_000_000_089), message)


def _stamp(message, stamp):
    for field, kind in message.get_fields_and_field_types().items():
        value = getattr(message, field)
        if kind == "builtin_interfaces/Time":
            setattr(message, field, stamp)
        elif "/" in kind:
            for inner in value if "sequence" in kind or "[" in kind else [value]:
                _stamp(inner, stamp)


def test_a_field_with_parts_of_one_type_is_one_view():
    message = ObkImu(header=Header(frame_id="odd"))
    packed = PackedMessage(message)
    packed.numbers("orientation")[:] = [1.0, 2.0, 3.0, 4.0]
    packed.numbers("angular_velocity_covariance")[4] = 5.0
    message.orientation.x, message.orientation.y = 1.0, 2.0
    message.orientation.z, message.orientation.w = 3.0, 4.0
    message.angular_velocity_covariance[4] = 5.0
    _assert_same(packed.to_bytes(0), message)


def test_returned_bytes_do_not_change_any_more():
    packed = PackedMessage(ObkJointEncoders(joint_pos=[1.0], joint_names=["a"]))
    before = packed.to_bytes(1)
    kept = bytes(bytearray(before))
    packed.numbers("joint_pos")[0] = 2.0
    assert packed.to_bytes(2) != kept
    assert before == kept


def test_numbers_deep_in_a_message_are_reached():
    message = MarkerArray(markers=[Marker(ns="a"), Marker(ns="bcd", text="é")])
    packed = PackedMessage(message)
    packed.numbers("markers.1.pose.position")[:] = [1.0, 2.0, 3.0]
    position = message.markers[1].pose.position
    position.x, position.y, position.z = 1.0, 2.0, 3.0
    _assert_same(packed.to_bytes(0), message)


def test_bytes_with_numbers_can_be_viewed_as_numbers():
    cloud = PointCloud2(fields=[PointField(name="x")], data=bytes(8))
    packed = PackedMessage(cloud)
    packed.numbers("data").view(np.float32)[:] = [1.5, -2.5]
    cloud.data = np.array([1.5, -2.5], np.float32).tobytes()
    _assert_same(packed.to_bytes(0), cloud)


@pytest.mark.parametrize("field", ["joint_pso", "joint_names", "header", "header.stamp", "joint_"])
def test_fields_other_than_numbers_of_one_type_are_rejected(field):
    packed = PackedMessage(ObkJointEncoders(joint_pos=[1.0], joint_names=["a"]))
    with pytest.raises(KeyError, match=field):
        packed.numbers(field)


def test_a_sequence_without_elements_has_no_numbers():
    with pytest.raises(KeyError):
        PackedMessage(ObkJointEncoders()).numbers("joint_vel")


def test_messages_without_numbers_are_packed_too():
    for message in (Empty(), String(data="text")):
        _assert_same(PackedMessage(message).to_bytes(0), message)


def test_wide_strings_are_rejected():
    class WithWideString(Header):
        SLOT_TYPES = (*Header.SLOT_TYPES[:1], UnboundedWString())

    with pytest.raises(ObeliskMsgError, match="`frame_id`"):
        PackedMessage(WithWideString())


def test_several_octets_or_booleans_are_one_field():
    message = ParameterValue(byte_array_value=[b"a", b"b"], bool_array_value=[True, False, True])
    packed = PackedMessage(message)
    assert packed.numbers("byte_array_value").tolist() == [97, 98]
    packed.numbers("bool_array_value")[1] = True
    message.bool_array_value[1] = True
    _assert_same(packed.to_bytes(0), message)
