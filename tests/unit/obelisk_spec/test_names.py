import pytest

from obelisk_spec.names import (
    OBELISK_MESSAGES,
    bare_name,
    namespace_fault,
    near_msg_types,
    node_name_fault,
    package_name_fault,
    resolve_msg_type,
    topic_name_fault,
)


@pytest.mark.parametrize("name", ["/a", "a", "/a/b_2", "~/a", "~", "a/b", "_x"])
def test_topic_names(name: str) -> None:
    assert topic_name_fault(name) is None


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("", "it is empty"),
        ("/", "it ends with `/`"),
        ("/a/", "it ends with `/`"),
        ("/a//b", "it contains `//`"),
        ("/3a", "`3a` starts with a digit"),
        ("/a-b", "'-' is not a letter, digit or `_`"),
        ("/a b", "' ' is not a letter, digit or `_`"),
        ("~a", "`~` must be followed by `/`"),
        ("a/~/b", "`~` is only allowed at the start"),
        ("/ä", "'ä' is not a letter, digit or `_`"),
        ("/" + "a" * 247, "it is longer than 247 characters"),
    ],
)
def test_an_invalid_topic_name_is_reported_with_the_reason(name: str, reason: str) -> None:
    assert topic_name_fault(name) == reason


def test_namespaces() -> None:
    assert namespace_fault("/") is None
    assert namespace_fault("/left/arm") is None
    assert namespace_fault("left") is None
    assert namespace_fault("a" * 246) == "it is longer than 245 characters"
    assert namespace_fault("/left//arm") == "it contains `//`"
    assert namespace_fault("~/left") == "'~' is not a letter, digit or `_`"


def test_node_names() -> None:
    assert node_name_fault("obelisk_control_0") is None
    assert node_name_fault("a" * 255) is None


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("left-arm", "'-' is not a letter, digit or `_`"),
        ("0_arm", "`0_arm` starts with a digit"),
        ("", "it is empty"),
        ("a" * 256, "it is longer than 255 characters"),
    ],
)
def test_an_invalid_node_name_is_reported_with_the_reason(name: str, reason: str) -> None:
    assert node_name_fault(name) == reason


def test_package_names() -> None:
    assert package_name_fault("obelisk_control_py") is None


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("src/demo", "it may contain only letters, digits, `_` and `-`"),
        ("de mo", "it may contain only letters, digits, `_` and `-`"),
        ("a", "it needs at least two characters"),
        ("", "it needs at least two characters"),
        ("3d", "it must start with a letter"),
        ("_demo", "it must start with a letter"),
    ],
)
def test_an_invalid_package_name_is_reported_with_the_reason(name: str, reason: str) -> None:
    assert package_name_fault(name) == reason


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
def test_an_invalid_type_resolves_to_none(written: str) -> None:
    assert resolve_msg_type(written) is None


def test_near_names_ignore_case_and_package() -> None:
    assert near_msg_types("ObkIMU")[0] == "ObkImu"
    assert near_msg_types("obelisk_control_msgs/PositionSetpiont")[0] == "PositionSetpoint"


def test_every_obelisk_message_is_found_bare() -> None:
    for package, names in OBELISK_MESSAGES.items():
        for name in names:
            assert resolve_msg_type(name) == f"{package}/msg/{name}"
            assert bare_name(f"{package}/msg/{name}") == name
