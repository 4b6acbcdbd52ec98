"""JSON with comments: read as editors do, one member set, everything else as it was."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obk_cli.jsonc import JsoncError, read_jsonc, set_member

COMMENTED = """\
{
  // mine: "a": {
  "editor.rulers": [100,], /* two
  lines */
  "http": "a//b",
  "schemas": {
    // others
    "other.json": "b",
  },
}
"""


def test_comments_and_last_commas_do_not_count() -> None:
    assert read_jsonc(COMMENTED) == {
        "editor.rulers": [100],
        "http": "a//b",
        "schemas": {"other.json": "b"},
    }


def test_a_member_goes_into_an_object_that_is_there() -> None:
    text = set_member(COMMENTED, ("schemas", "mine.json"), ["x"])
    assert text == COMMENTED.replace(
        '  "schemas": {\n',
        '  "schemas": {\n    "mine.json": [\n      "x"\n    ],\n',
    )


def test_missing_objects_are_made() -> None:
    assert set_member('{"a": 1}\n', ("s", "k"), True) == (
        '{\n    "s": {\n        "k": true\n    },"a": 1}\n'
    )
    assert set_member("{}\n", ("s",), 1) == '{\n    "s": 1\n}\n'
    assert set_member("{ // mine\n}\n", ("s",), 1) == '{\n    "s": 1 // mine\n}\n'
    assert set_member("{\r\n}\r\n", ("s",), 1) == '{\r\n    "s": 1\r\n}\r\n'


def test_a_member_that_is_there_is_replaced() -> None:
    assert set_member('{"a": [1, {"b": 2}], "c": 3}', ("a",), 0) == '{"a": 0, "c": 3}'
    assert set_member('\ufeff{"a": {"b": 1}}', ("a", "b"), 2) == '\ufeff{"a": {"b": 2}}'


@pytest.mark.parametrize("text", ["", "{", '{"a" 1}', "{'a': 1}", '{"a": [}', "// only", "{} {}"])
def test_what_is_not_json_is_refused(text: str) -> None:
    with pytest.raises(JsoncError):
        set_member(text, ("a",), 1)


@pytest.mark.parametrize("text", ["[]", '"a"', '{"a": 1}'])
def test_a_member_of_what_is_no_object_is_refused(text: str) -> None:
    with pytest.raises(JsoncError, match="is no object"):
        set_member(text, ("a", "b"), 1)


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=6),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner),
    max_leaves=8,
)


@given(st.dictionaries(st.text(max_size=4), VALUES), st.text(max_size=4), VALUES, st.integers(0, 4))
def test_any_object_gains_the_member(
    there: dict[str, object], key: str, value: object, indent: int
) -> None:
    text = json.dumps(there, indent=indent or None)
    assert read_jsonc(set_member(text, (key,), value)) == {**there, key: value}


def test_a_fault_is_told_at_its_place_in_the_text() -> None:
    with pytest.raises(JsoncError, match=r"line 3 column 7 "):
        read_jsonc('{ // mine\n  "a": 1, /* two */\n  "b" 2\n}\n')


def test_a_text_nested_too_deep_is_no_json() -> None:
    with pytest.raises(JsoncError):
        read_jsonc("[" * 100_000)
