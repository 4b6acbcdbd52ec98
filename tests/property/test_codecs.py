"""Codecs compared with rclpy's serialization: same bytes, same values, same errors."""

import array
import importlib
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from obelisk_estimator_msgs.msg import EstimatedState
from rclpy.serialization import deserialize_message, serialize_message
from rosidl_parser.definition import (
    AbstractString,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
)

from obelisk_py.core.exceptions import ObeliskMsgError
from obelisk_py.core.serialization.cdr_types import HEADER_SIZE
from obelisk_py.core.serialization.codec import codec_for

INTERFACES = Path(__file__).resolve().parents[2] / "interfaces"
OWN = sorted(f"{f.parents[1].name}/{f.stem}" for f in INTERFACES.glob("obelisk_*/msg/*.msg"))
OTHERS = [
    "action_msgs/GoalStatusArray",
    "diagnostic_msgs/DiagnosticArray",
    "geometry_msgs/Polygon",
    "geometry_msgs/PoseWithCovarianceStamped",
    "lifecycle_msgs/TransitionEvent",
    "nav_msgs/OccupancyGrid",
    "nav_msgs/Odometry",
    "rcl_interfaces/ParameterDescriptor",
    "rcl_interfaces/ParameterValue",
    "sensor_msgs/BatteryState",
    "sensor_msgs/Image",
    "sensor_msgs/Imu",
    "sensor_msgs/JointState",
    "sensor_msgs/NavSatFix",
    "sensor_msgs/PointCloud2",
    "service_msgs/ServiceEventInfo",
    "std_msgs/ByteMultiArray",
    "std_msgs/Empty",
    "std_msgs/Int16MultiArray",
    "std_msgs/Int64MultiArray",
    "std_msgs/UInt64",
    "trajectory_msgs/JointTrajectory",
    "type_description_interfaces/TypeDescription",
    "unique_identifier_msgs/UUID",
    "visualization_msgs/InteractiveMarker",
    "visualization_msgs/MarkerArray",
]
NUMBERS = {
    "boolean": st.booleans(),
    "octet": st.binary(min_size=1, max_size=1),
    "float": st.floats(width=32),
    "double": st.floats(),
    **{
        f"{sign}int{bits}": st.integers(
            -(1 << bits - 1) if not sign else 0, (1 << bits - (not sign)) - 1
        )
        for sign in ("", "u")
        for bits in (8, 16, 32, 64)
    },
}
SOME = 3
ENOUGH = settings(max_examples=15, deadline=None)
FEW = settings(max_examples=4, deadline=None)


def class_of(name: str) -> Any:
    package, _, bare = name.partition("/")
    return getattr(importlib.import_module(f"{package}.msg"), bare)


def values(kind: Any) -> st.SearchStrategy[Any]:
    if isinstance(kind, BasicType):
        return NUMBERS[kind.typename]
    if isinstance(kind, NamespacedType):
        return messages(class_of(f"{kind.namespaces[0]}/{kind.name}"))
    if isinstance(kind, AbstractString):
        # Lone surrogates cannot be encoded in UTF-8.
        return st.text(st.characters(codec="utf-8"), max_size=8)
    if isinstance(kind, Array):
        return st.lists(values(kind.value_type), min_size=kind.size, max_size=kind.size)
    most = min(SOME, kind.maximum_size) if isinstance(kind, BoundedSequence) else SOME
    return st.lists(values(kind.value_type), max_size=most)


def messages(message_class: Any) -> st.SearchStrategy[Any]:
    """Any message of a class."""
    slots = [slot.removeprefix("_") for slot in message_class.__slots__]
    kinds = dict(zip(slots, message_class.SLOT_TYPES, strict=False))
    return st.builds(message_class, **{name: values(kind) for name, kind in kinds.items()})


def differs_in_padding_only(data: bytes, by_rclpy: bytes) -> bool:
    """Padding is undefined in rclpy and zero in the library."""
    differing = [ours for ours, its in zip(data, by_rclpy, strict=False) if ours != its]
    return len(data) <= len(by_rclpy) and not any(differing)


def is_same(one: Any, other: Any) -> bool:
    """Equal in values and types; NaN is equal to itself."""
    if type(one) is not type(other):
        return False
    if hasattr(one, "SLOT_TYPES"):
        return all(is_same(getattr(one, slot), getattr(other, slot)) for slot in one.__slots__)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(is_same, one, other))
    if isinstance(one, array.array):
        return one.typecode == other.typecode and one.tobytes() == other.tobytes()
    if isinstance(one, np.ndarray):
        flags = one.flags.writeable == other.flags.writeable
        return flags and one.dtype == other.dtype and one.tobytes() == other.tobytes()
    if isinstance(one, float):
        return struct.pack("d", one) == struct.pack("d", other)
    return bool(one == other)


def cut_at_nul(message: Any) -> Any:
    """The message after conversion in C, where a string ends at its first NUL."""
    return deserialize_message(serialize_message(message), type(message))


@pytest.mark.parametrize("name", [*OWN, *OTHERS])
def test_bytes_values_and_types_are_those_of_rclpy(name):
    message_class = class_of(name)
    codec = codec_for(message_class)
    assert codec is not None

    @ENOUGH
    @given(messages(message_class))
    def check(message):
        by_rclpy = serialize_message(message)
        cut = cut_at_nul(message)
        data = codec.pack(message)
        assert data[:HEADER_SIZE] == by_rclpy[:HEADER_SIZE]
        assert differs_in_padding_only(data, by_rclpy)
        assert is_same(deserialize_message(data, message_class), cut)
        assert is_same(codec.unpack(by_rclpy), cut)
        assert is_same(codec.unpack(data), cut)
        assert is_same(codec.copy(message), cut)
        assert codec.pack(codec.copy(message)) == data

    check()


@pytest.mark.parametrize("name", [*OWN, *OTHERS])
def test_truncated_bytes_are_rejected(name):
    codec = codec_for(class_of(name))

    @FEW
    @given(messages(class_of(name)))
    def check(message):
        data = codec.pack(message)
        for end in range(len(data)):
            with pytest.raises(ObeliskMsgError):
                codec.unpack(data[:end])

    check()


@pytest.mark.parametrize("name", [*OWN, *OTHERS])
def test_corrupted_bytes_are_rejected_or_read_as_by_rclpy(name):
    message_class = class_of(name)
    codec = codec_for(message_class)

    @ENOUGH
    @given(messages(message_class), st.data())
    def check(message, data):
        wrong = bytearray(codec.pack(message))
        at = st.integers(HEADER_SIZE, len(wrong) - 1)
        for place, byte in data.draw(st.lists(st.tuples(at, st.integers(0, 255)), max_size=4)):
            wrong[place] = byte
        try:
            found = codec.unpack(bytes(wrong))
        except ObeliskMsgError:
            return
        assert is_same(found, deserialize_message(bytes(wrong), message_class))

    check()


@given(st.binary(max_size=200))
def test_any_bytes_give_a_message_or_the_librarys_own_error(data):
    codec = codec_for(EstimatedState)
    for beginning in (b"", b"\0\1\0\0"):
        try:
            found = codec.unpack(beginning + data)
        except ObeliskMsgError:
            continue
        assert isinstance(found, EstimatedState)
