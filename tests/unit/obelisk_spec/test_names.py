import pytest

from obelisk_spec.names import (
    namespace_fault,
    node_name_fault,
    package_name_fault,
    topic_name_fault,
)


@pytest.mark.parametrize("name", ["/a", "a", "/a/b_2", "~/a", "~", "a/b", "_x"])
def test_topic_names(name: str) -> None:
    assert topic_name_fault(name) is None


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("", "empty"),
        ("/", "ends with `/`"),
        ("/a/", "ends with `/`"),
        ("/a//b", "`//`"),
        ("/3a", "`3a` starts with a digit"),
        ("/a-b", "'-'"),
        ("/a b", "' '"),
        ("~a", "`~`"),
        ("a/~/b", "`~`"),
        ("/ä", "'ä'"),
    ],
)
def test_what_is_no_topic_name_says_why(name: str, reason: str) -> None:
    assert reason in str(topic_name_fault(name))


def test_namespaces() -> None:
    assert namespace_fault("/") is None
    assert namespace_fault("/left/arm") is None
    assert namespace_fault("left") is None
    assert namespace_fault("/left//arm")
    assert namespace_fault("~/left")


def test_node_names() -> None:
    assert node_name_fault("obelisk_control_0") is None
    assert node_name_fault("left-arm")
    assert node_name_fault("0_arm")
    assert node_name_fault("")
    assert node_name_fault("a" * 256)


def test_package_names() -> None:
    assert package_name_fault("obelisk_control_py") is None
    for name in ("src/demo", "a", "3d", "_demo", "de mo", ""):
        assert package_name_fault(name), name
