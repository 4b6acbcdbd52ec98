"""Fields of recorded messages by name, and the numbers in them."""

from array import array
from typing import Any

import pytest

from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.record.plot import FieldName, PlotField, parse_field, resolve_topic


class Vector:
    __slots__ = ("x", "y")

    def __init__(self, x: float, y: float) -> None:
        self.x, self.y = x, y


class Message:
    __slots__ = ("frame", "gyro", "ok", "position", "sides")

    def __init__(self, **values: Any) -> None:
        self.frame = "world"
        self.gyro = Vector(1.0, 2.0)
        self.ok = True
        self.position = array("d", (3.0, 4.0))
        self.sides = [Vector(5.0, 6.0)]
        for name, value in values.items():
            setattr(self, name, value)


def lines(text: str, *messages: Message) -> dict[str, list[float]]:
    found = PlotField(parse_field(text))
    for second, message in enumerate(messages or (Message(),)):
        found.add(float(second), message)
    return {line.label: line.values for line in found.lines}


def test_a_field_is_a_topic_and_the_way_into_its_message() -> None:
    assert parse_field("/arm/imu.sides[2].x") == FieldName(
        topic="/arm/imu", steps=("sides", 2, "x"), text="/arm/imu.sides[2].x"
    )


@pytest.mark.parametrize("text", ["imu", "imu.", ".x", "imu.x..y", "imu.x[a]", "imu.x y", ""])
def test_what_is_no_field_is_told(text: str) -> None:
    with pytest.raises(MisuseError, match="names no field"):
        parse_field(text)


def test_a_number_is_one_line_an_array_or_a_message_one_for_each_number() -> None:
    assert lines("t.gyro.x") == {"": [1.0]}
    assert lines("t.ok") == {"": [1.0]}
    assert lines("t.position") == {"[0]": [3.0], "[1]": [4.0]}
    assert lines("t.position[1]") == {"": [4.0]}
    assert lines("t.gyro") == {".x": [1.0], ".y": [2.0]}
    assert lines("t.sides") == {"[0].x": [5.0], "[0].y": [6.0]}


def test_an_array_that_grows_and_shrinks_has_the_numbers_that_are_there() -> None:
    shorter = Message(position=[7.0])
    assert lines("t.position", shorter, Message()) == {"[0]": [7.0, 3.0], "[1]": [4.0]}
    assert lines("t.position[1]", shorter, Message()) == {"": [4.0]}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("t.giro", "did you mean `gyro`"),
        ("t.gyro.z", "`x`, `y`"),
        ("t.frame", "holds no number"),
        ("t.gyro[0]", "is of no array"),
        ("t.gyro.x.y", "there is no field `y`"),
    ],
)
def test_a_field_that_is_not_there_is_told_with_those_that_are(text: str, told: str) -> None:
    with pytest.raises(CommandFailedError) as error:
        lines(text)
    assert told in f"{error.value.message} {error.value.help}"


def test_more_lines_than_can_be_told_apart_are_refused() -> None:
    with pytest.raises(CommandFailedError) as error:
        lines("t.position", Message(position=[0.0] * 100))
    assert error.value.help == "name one of them: t.position[32]"


def test_a_topic_may_be_named_by_its_end() -> None:
    topics = ["/arm/imu", "/leg/imu", "/arm/est"]
    assert resolve_topic("/arm/imu", topics) == "/arm/imu"
    assert resolve_topic("est", topics) == "/arm/est"
    with pytest.raises(CommandFailedError, match="means several topics"):
        resolve_topic("imu", topics)
    with pytest.raises(CommandFailedError, match="has no topic `st`"):
        resolve_topic("st", topics)


@pytest.mark.parametrize("text", [f"/a.b[{'9' * 5000}]", "/a.b[\u0661]", "/a.b[-1]"])
def test_a_place_that_no_array_has_names_no_field(text: str) -> None:
    with pytest.raises(MisuseError, match="names no field"):
        parse_field(text)
