"""Fields selected by a user, checked against types and read from messages."""

from array import array

import pytest

from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.ros.field_path import (
    MISSING,
    ArrayType,
    Message,
    Number,
    Text,
    check_selection,
    parse_selection,
    parse_type,
    selected,
)

from .definitions import Message as FakeMessage
from .definitions import fields_of


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("double", Number("double")),
        ("octet", Number("octet")),
        ("string", Text()),
        ("wstring", Text()),
        ("string<10>", Text(10)),
        ("std_msgs/Header", Message("std_msgs/Header")),
        ("double[9]", ArrayType(Number("double"), 9, "exactly")),
        ("sequence<double>", ArrayType(Number("double"))),
        ("sequence<string<4>>", ArrayType(Text(4))),
        ("sequence<string<4>, 7>", ArrayType(Text(4), 7, "most")),
        ("sequence<pkg/Point, 3>", ArrayType(Message("pkg/Point"), 3, "most")),
        ("string<4>[2]", ArrayType(Text(4), 2, "exactly")),
    ],
)
def test_the_types_that_generated_packages_name_are_understood(text: str, expected: object) -> None:
    assert parse_type(text) == expected


def test_a_selection_is_names_and_places() -> None:
    assert parse_selection("points[2].x").steps == ("points", 2, "x")
    assert parse_selection(".header.stamp").steps == ("header", "stamp")


@pytest.mark.parametrize("text", ["", "a..b", "a[", "a[-1]", "a b", "1"])
def test_an_invalid_field_name_is_misuse(text: str) -> None:
    with pytest.raises(MisuseError, match="does not name a field"):
        parse_selection(text)


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("q_joints[7]", Number("double")),
        ("header.stamp.sec", Number("int32")),
        ("corners[0].y", Number("float")),
        ("gains", ArrayType(Number("double"), 3, "exactly")),
    ],
)
def test_an_existing_field_has_its_type(text: str, kind: object) -> None:
    assert check_selection(parse_selection(text), "pkg/State", fields_of) == kind


@pytest.mark.parametrize(
    ("text", "message", "help"),
    [
        ("q_joint", "`q_joint`: pkg/State has no field `q_joint`", "did you mean `q_joints`?"),
        (
            "header.stamp.nsec",
            "`header.stamp.nsec`: builtin_interfaces/Time has no field `nsec`",
            "did you mean `sec` or `nanosec`?",
        ),
        ("gains[3]", "`gains[3]`: the array has 3", None),
        ("few[2]", "`few[2]`: the array holds at most 2", None),
        ("name[0]", "`name[0]`: [0] needs an array", None),
        ("q_joints.x", "`q_joints.x`: `x` needs a message", None),
        ("count.x", "`count.x`: `x` needs a message", None),
    ],
)
def test_a_missing_field_is_reported_with_the_existing_ones(
    text: str, message: str, help: str | None
) -> None:
    with pytest.raises(CommandFailedError) as caught:
        check_selection(parse_selection(text), "pkg/State", fields_of)
    assert (caught.value.message, caught.value.help) == (message, help)


def test_the_value_of_a_message_is_read_if_it_exists() -> None:
    message = FakeMessage(q=array("d", [0.5, 1.5]), at=FakeMessage(x=3))
    assert selected(message, parse_selection("q[1]")) == 1.5
    assert selected(message, parse_selection("at.x")) == 3
    assert selected(message, parse_selection("q[2]")) is MISSING


def test_the_value_of_a_message_that_is_plain_data_is_taken_as_well() -> None:
    message = {"q": [0.5, 1.5], "at": {"x": 3}}
    assert selected(message, parse_selection("q[1]")) == 1.5
    assert selected(message, parse_selection("at.x")) == 3
    assert selected(message, parse_selection("q[2]")) is MISSING
