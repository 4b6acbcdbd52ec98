"""Codecs of message classes: what they convert, reject and copy."""

import struct
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from obelisk_sensor_msgs.msg import ObkImu, ObkJointEncoders
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, ParameterValue
from rosidl_parser.definition import UnboundedWString
from sensor_msgs.msg import JointState
from std_msgs.msg import (
    Bool,
    Byte,
    Empty,
    Float32,
    Float64,
    Float64MultiArray,
    Header,
    Int32,
    String,
    UInt8,
)
from type_description_interfaces.msg import FieldType

from obelisk_py.core.exceptions import ObeliskMsgError
from obelisk_py.core.serialization.codec import codec_for


def test_a_big_endian_message_is_left_to_rclpy():
    data = b"\0\0\0\0" + struct.pack(">iI", 7, 8)
    assert codec_for(Time).unpack(data) == Time(sec=7, nanosec=8)


def test_a_copy_shares_nothing_that_can_change():
    joints = JointState(name=["a", "b"], position=[1.0, 2.0], header=Header(frame_id="base"))
    codec = codec_for(JointState)
    first, second = codec.copy(joints), codec.copy(joints)
    first.name.append("c")
    first.position[0] = 7.0
    first.header.stamp.sec = 9
    for other in (joints, second, codec.copy(joints), codec.unpack(codec.pack(joints))):
        assert (other.name, other.position[0], other.header.stamp.sec) == (["a", "b"], 1.0, 0)
    imu = codec_for(ObkImu).copy(ObkImu())
    imu.orientation_covariance[0] = 1.0
    assert codec_for(ObkImu).copy(ObkImu()).orientation_covariance[0] == 0.0


def test_cached_names_are_not_changed_by_readers():
    codec = codec_for(ObkJointEncoders)
    names = ["hip", "knee"]
    data = codec.pack(ObkJointEncoders(joint_names=names))
    names[1] = "ankle"
    assert codec.unpack(codec.pack(ObkJointEncoders(joint_names=names))).joint_names == names
    codec.unpack(data).joint_names.clear()
    assert codec.unpack(data).joint_names == ["hip", "knee"]


def test_numbers_of_another_kind_are_converted():
    assert codec_for(Float64).unpack(codec_for(Float64).pack(Float64(data=3))).data == 3.0
    numpy_number = Float64(data=np.float32(1.5))
    assert codec_for(Float64).copy(numpy_number).data == 1.5
    assert codec_for(Int32).copy(Int32(data=np.int64(-4))).data == -4
    flag = codec_for(Bool).copy(Bool(data=np.True_))
    assert flag.data is True


def with_value(message_class: Any, slot: str, value: Any) -> Any:
    message = message_class()
    setattr(message, slot, value)
    return message


RANGES = [FloatingPointRange()] * 2


@pytest.mark.parametrize(
    ("message", "field"),
    [
        (Float64(data="1.5"), "`data` of std_msgs/msg/Float64 is '1.5', expected double"),
        (Float64(data=None), "`data`"),
        (Float32(data=1e300), "`data` of std_msgs/msg/Float32 is 1e+300, expected float"),
        (Int32(data=1.5), "`data` of std_msgs/msg/Int32 is 1.5, expected int32"),
        (UInt8(data=300), "`data` of std_msgs/msg/UInt8 is 300, expected uint8"),
        (UInt8(data=-1), "`data`"),
        (Bool(data=1), "`data` of std_msgs/msg/Bool is 1, expected boolean"),
        (Bool(data="yes"), "`data`"),
        (Byte(data=b"ab"), "`data` of std_msgs/msg/Byte is b'ab', expected octet"),
        (Byte(data=7), "`data`"),
        (String(data=3), "`data` of std_msgs/msg/String is 3, expected string"),
        (String(data=b"abc"), "`data`"),
        (String(data="\ud800"), "`data`"),
        (Header(stamp=Time(sec=2**31)), "`stamp.sec` of std_msgs/msg/Header is 2147483648"),
        (PoseStamped(header=None), "no field `header.stamp.sec`"),
        (JointState(name="hip"), "`name` of sensor_msgs/msg/JointState is 'hip', expected"),
        (JointState(name=["hip", 3]), "`name`"),
        (JointState(name=None), "`name`"),
        (with_value(JointState, "_position", "ab"), "`position`"),
        (with_value(JointState, "_position", ["a"]), "`position`"),
        (ObkImu(orientation_covariance=[0.0] * 8), "its shape is (8,), expected (9,)"),
        (FieldType(nested_type_name="x" * 256), "its length is 256, expected at most 255"),
        (ParameterDescriptor(floating_point_range=RANGES), "its length is 2, expected at most 1"),
        (ParameterValue(bool_array_value=[True, 2]), "`bool_array_value`"),
        (ParameterValue(byte_array_value=[b"a", b""]), "`byte_array_value`"),
    ],
)
def test_values_that_a_type_cannot_hold_are_rejected_by_name_before_sending(message, field):
    codec = codec_for(type(message))
    for convert in (codec.pack, codec.copy):
        with pytest.raises(ObeliskMsgError) as raised:
            convert(message)
        assert field in str(raised.value)


def test_invalid_bytes_are_reported():
    codec = codec_for(Header)
    data = codec.pack(Header(frame_id="base"))
    with pytest.raises(ObeliskMsgError) as raised:
        codec.unpack(data[:-2])
    assert str(raised.value) == (
        "19 bytes are not a std_msgs/msg/Header: at `frame_id`, they end too early"
    )
    with pytest.raises(ObeliskMsgError, match=r"8 bytes .* they end before `stamp.nanosec` does"):
        codec.unpack(data[:8])
    with pytest.raises(ObeliskMsgError, match="neither false nor true"):
        codec_for(Bool).unpack(b"\0\1\0\0\2")
    assert codec_for(Empty).unpack(b"\0\1\0\0\0") == Empty()


def test_a_length_that_cannot_be_is_rejected_before_memory_is_taken():
    huge = b"\0\1\0\0" + b"\xff" * 8
    for message_class in (Header, String, Float64MultiArray):
        with pytest.raises(ObeliskMsgError):
            codec_for(message_class).unpack(huge)


def test_a_message_with_a_wide_string_has_no_codec():
    class WithWideString(Header):
        SLOT_TYPES = (*Header.SLOT_TYPES[:1], UnboundedWString())

    assert codec_for(WithWideString) is None


def test_the_generated_source_can_be_read():
    source = codec_for(Header).source
    for line in ("m1 = m0._stamp", "value = m0._frame_id", "n1 = n0._stamp = new_1(Time_1)"):
        assert line in source
    assert "$" not in source
