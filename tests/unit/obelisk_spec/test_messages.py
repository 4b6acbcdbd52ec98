import pytest

from obelisk_spec.messages import (
    OBELISK_MESSAGES,
    bare_name,
    near_msg_types,
    resolve_msg_type,
)


@pytest.mark.parametrize(
    ("written", "full"),
    [
        ("PositionSetpoint", "obelisk_control_msgs/msg/PositionSetpoint"),
        ("JointEncoders", "obelisk_sensor_msgs/msg/JointEncoders"),
        ("Imu", "sensor_msgs/msg/Imu"),
        ("sensor_msgs/Imu", "sensor_msgs/msg/Imu"),
        ("sensor_msgs/msg/Imu", "sensor_msgs/msg/Imu"),
        ("UInt8MultiArray", "obelisk_std_msgs/msg/UInt8MultiArray"),
        ("std_msgs/UInt8MultiArray", "std_msgs/msg/UInt8MultiArray"),
        ("my_msgs/Thing", "my_msgs/msg/Thing"),
    ],
)
def test_a_type_is_found_by_each_of_its_names(written: str, full: str) -> None:
    assert resolve_msg_type(written) == full


@pytest.mark.parametrize(
    "written",
    ["ObkIMU", "", "/", "sensor_msgs/srv/Imu", "obelisk_sensor_msgs/Imu", "my msgs/Thing", "a/b"],
)
def test_what_is_no_type_resolves_to_none(written: str) -> None:
    assert resolve_msg_type(written) is None


def test_near_names_ignore_case_and_package() -> None:
    assert near_msg_types("ObkIMU")[0] == "ObkImu"
    assert near_msg_types("obelisk_control_msgs/PositionSetpiont")[0] == "PositionSetpoint"


def test_every_obelisk_message_is_found_bare() -> None:
    for package, names in OBELISK_MESSAGES.items():
        for name in names:
            assert resolve_msg_type(name) == f"{package}/msg/{name}"
            assert bare_name(f"{package}/msg/{name}") == name
