"""Messages as text, CSV and JSON."""

import csv
import json
from array import array

import pytest
import yaml

from obk_cli.introspect.message_text import (
    MOST_ITEMS,
    MOST_LETTERS,
    MessageFormatter,
    json_line,
    message_text,
)
from obk_cli.ros.field_path import parse_selection
from obk_cli.ros.message_data import Plain, columns, plain_data

from ..ros.definitions import Message  # noqa: TID252 - shared by folders of tests


def whole() -> Message:
    return Message(
        header=Message(stamp=Message(sec=1, nanosec=5), frame_id="tip, \x1b[2J"),
        q=array("d", [0.5, -0.25]),
        points=[Message(x=1.0), Message(x=2.0)],
        empty=[],
        mark=b"\x07",
        is_on=True,
    )


PLAIN: Plain = {
    "header": {"stamp": {"sec": 1, "nanosec": 5}, "frame_id": "tip, \x1b[2J"},
    "q": [0.5, -0.25],
    "points": [{"x": 1.0}, {"x": 2.0}],
    "empty": [],
    "mark": 7,
    "is_on": True,
}


def shower(*fields: str, format: str = "text", is_whole: bool = False) -> MessageFormatter:
    def warn(sentence: str) -> None:
        warnings.append(sentence)

    return MessageFormatter(
        [parse_selection(f) for f in fields], format, is_whole=is_whole, warn=warn
    )


warnings: list[str] = []


@pytest.fixture(autouse=True)
def _no_warnings() -> None:
    warnings.clear()


def test_a_message_is_converted_to_plain_data() -> None:
    assert plain_data(whole()) == PLAIN


def test_the_text_output_is_yaml_that_reads_back_equal() -> None:
    text = "\n".join(message_text(PLAIN, is_whole=True))
    assert yaml.safe_load(text) == PLAIN
    assert "\x1b" not in text
    (odd,) = message_text("\x9b2J \u202e\n", is_whole=True)
    assert odd == r'"\u009b2J \u202e\n"'
    assert yaml.safe_load(odd) == "\x9b2J \u202e\n"


def test_long_arrays_and_texts_are_cut_for_a_person_only() -> None:
    many: Plain = {"q": list(range(30)), "texts": ["a"], "far": [{"x": n} for n in range(20)]}
    text = list(message_text(many, is_whole=False))
    assert text[0] == f"q: [{', '.join(map(str, range(MOST_ITEMS)))}, ... 18 more]"
    assert text[-1] == "  # and 8 more"
    assert yaml.safe_load("\n".join(message_text(many, is_whole=True))) == many
    (cut,) = message_text("x" * 300, is_whole=False)
    assert cut == f'"{"x" * MOST_LETTERS}..."'


def test_non_finite_numbers_are_reported() -> None:
    assert list(message_text([float("nan"), float("-inf")], is_whole=True)) == ["[.nan, -.inf]"]
    assert json_line({"x": [float("nan"), 1.5]}) == '{"x": ["nan", 1.5]}'


def test_single_values_have_names() -> None:
    names = [name for name, _ in columns(PLAIN, "")]
    assert names[:4] == ["header.stamp.sec", "header.stamp.nanosec", "header.frame_id", "q[0]"]
    assert "points[1].x" in names


def test_a_row_of_csv_is_read_back_by_another_reader() -> None:
    (row,) = csv.DictReader(shower(format="csv").lines(whole()))
    assert row["header.frame_id"] == "tip, \\u001b[2J"
    assert float(row["q[1]"]) == -0.25
    assert row["is_on"] == "true"


def test_one_selected_number_is_a_line() -> None:
    assert list(shower("q[1]").lines(whole())) == ["-0.25"]


def test_a_missing_element_is_null_as_in_yaml() -> None:
    assert list(shower("q[9]").lines(whole())) == ["null"]


def test_several_selected_fields_are_reported_apart() -> None:
    assert list(shower("q[0]", "header.stamp").lines(whole())) == [
        "q[0]: 0.5",
        "header.stamp:",
        "  sec: 1",
        "  nanosec: 5",
        "---",
    ]


def test_json_has_the_selected_fields_by_name_and_all_of_them() -> None:
    (line,) = shower("q", "q[9]", format="json").lines(whole())
    assert json.loads(line) == {"q": [0.5, -0.25], "q[9]": None}
    (line,) = shower(format="json").lines(whole())
    assert json.loads(line) == PLAIN


def test_csv_names_its_columns_once_and_warns_once_of_others() -> None:
    shown = shower("q", format="csv")
    first = list(shown.lines(Message(q=[1.0, 2.0])))
    assert first == ["q[0],q[1]", "1.0,2.0"]
    assert list(shown.lines(Message(q=[3.0, 4.0]))) == ["3.0,4.0"]
    assert not warnings
    assert list(shown.lines(Message(q=[5.0, 6.0, 7.0]))) == ["5.0,6.0"]
    assert list(shown.lines(Message(q=[5.0, 6.0, 7.0]))) == ["5.0,6.0"]
    (warning,) = warnings
    assert "1 more columns than the first one, starting with `q[2]`" in warning


def test_a_column_of_csv_keeps_its_meaning() -> None:
    shown = shower("q", "mark", format="csv")
    list(shown.lines(Message(q=[1.0, 2.0], mark=7)))
    assert list(shown.lines(Message(q=[5.0], mark=8))) == ["5.0,,8"]
    assert not warnings


def test_an_empty_array_first_takes_no_columns_for_csv() -> None:
    shown = shower("q", format="csv")
    assert list(shown.lines(Message(q=[]))) == []
    assert list(shown.lines(Message(q=[1.0]))) == ["q[0]", "1.0"]
