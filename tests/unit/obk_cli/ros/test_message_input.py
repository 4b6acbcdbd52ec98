"""Messages typed by a user, checked against their type."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obelisk_spec.yaml_core import load_yaml_core
from obk_cli.errors import MisuseError
from obk_cli.ros.message_data import Now, fill, require_fit

from .definitions import fields_of


def faults(text: str) -> tuple[str, ...]:
    return fill(load_yaml_core(text), "pkg/State", fields_of).faults


def test_matching_values_are_accepted_and_numbers_converted() -> None:
    text = """
    {header: {stamp: now, frame_id: base}, q_joints: [1, 2e-3, .inf], few: [-128],
     corners: [{x: 1}, {}], name: abcde, is_on: true, count: 255, mark: 7}
    """
    filled = fill(load_yaml_core(text), "pkg/State", fields_of)
    assert filled.faults == ()
    assert filled.data == {
        "header": {"stamp": Now.NOW, "frame_id": "base"},
        "q_joints": [1.0, 0.002, math.inf],
        "few": [-128],
        "corners": [{"x": 1.0}, {}],
        "name": "abcde",
        "is_on": True,
        "count": 255,
        "mark": 7,
    }


def test_an_empty_value_is_a_default_message() -> None:
    assert fill(None, "pkg/State", fields_of).data == {}


def test_invalid_values_are_rejected_with_their_faults_and_the_fields() -> None:
    text = f"{{{', '.join(f'wrong_{number}: 1' for number in range(22))}}}"
    with pytest.raises(MisuseError, match="the message does not fit pkg/Point:") as refused:
        require_fit(load_yaml_core(text), "pkg/Point", fields_of)
    assert refused.value.message.endswith("\n  and 2 more")
    assert refused.value.help == "x: double, y: float"


def test_a_header_may_be_left_to_the_time_of_publishing() -> None:
    filled = fill({"header": "auto"}, "pkg/State", fields_of)
    assert (filled.data, filled.faults) == ({"header": {"stamp": Now.NOW}}, ())


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("{q_joint: [1]}", "q_joint: pkg/State has no such field; did you mean `q_joints`?"),
        ("{count:3}", "count:3: pkg/State has no such field; a space is missing: `count: 3`"),
        ("{q_joints: 1}", "q_joints: expected a list of doubles, got `1`"),
        ("{q_joints: [1, a]}", "q_joints[1]: expected a double, got `a`"),
        ("{q_joints: [true]}", "q_joints[0]: expected a double, got true"),
        ("{gains: [1, 2]}", "gains: expected a list of 3 doubles, got 2"),
        ("{few: [1, 2, 3]}", "few: expected a list of at most 2 int8s, got 3"),
        ("{few: [128]}", "few[0]: expected a whole number from -128 to 127 (int8), got `128`"),
        ("{few: [1.0]}", "few[0]: expected a whole number from -128 to 127 (int8), got `1.0`"),
        ("{corners: [3]}", "corners[0]: expected pkg/Point {x: double, y: float}, got `3`"),
        ("{corners: [{y: 1e39}]}", "corners[0].y: expected a float, got `1e+39`"),
        ("{name: 5}", 'name: expected a string, got `5`; write "5"'),
        ("{name: abcdef}", "name: expected at most 5 characters, got 6"),
        ("{is_on: 1}", "is_on: expected true or false, got `1`"),
        ("{is_on: {}}", "is_on: expected true or false, got an object"),
        ("{mark: 256}", "mark: expected a whole number from 0 to 255 (octet), got `256`"),
        (
            "{header: {stamp: soon}}",
            "header.stamp: expected builtin_interfaces/Time {sec: int32, nanosec: uint32} or "
            "`now`, got `soon`",
        ),
    ],
)
def test_mismatched_values_are_reported_with_the_expected_type(text: str, fault: str) -> None:
    assert faults(text) == (fault,)


def test_every_fault_is_reported() -> None:
    assert len(faults("{q_joints: [a, b], count: -1, is_on: 3, nothing: 1}")) == 5


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.text(max_size=4) | st.integers(), inner, max_size=4)
    ),
    max_leaves=8,
)


@given(values)
def test_any_value_gives_data_or_faults(value: object) -> None:
    filled = fill(value, "pkg/State", fields_of)
    assert isinstance(filled.data, dict)


@given(st.dictionaries(st.sampled_from(["q_joints", "gains", "few", "count", "name"]), values))
def test_data_without_faults_is_taken_again_as_it_is(value: dict[str, object]) -> None:
    filled = fill(value, "pkg/State", fields_of)
    if not filled.faults:
        again = fill(filled.data, "pkg/State", fields_of)
        assert again.faults == ()
        assert repr(again.data) == repr(filled.data)
