"""Limits, units and times of effect in a descriptor's text survive writing and reading."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obelisk_spec.parameter_notes import ParameterNotes, parse_notes

finite = st.one_of(st.none(), st.floats(allow_nan=False, allow_infinity=False), st.integers())
words = st.text("abcdefg /^2", max_size=12).map(str.strip)


@given(
    notes=st.builds(
        ParameterNotes,
        unit=words,
        least=finite,
        most=finite,
        choices=st.lists(st.text("abc", min_size=1), max_size=3).map(tuple),
        is_live=st.sampled_from([None, True, False]),
        initial=st.one_of(
            st.none(), st.booleans(), st.text(), finite, st.lists(st.integers()).map(tuple)
        ),
    )
)
def test_written_notes_are_read_back(notes: ParameterNotes) -> None:
    assert parse_notes(notes.text(has_range_field=False)) == notes


@given(text=st.text())
def test_any_text_of_other_software_is_read(text: str) -> None:
    parse_notes(text)


def test_the_documented_form() -> None:
    notes = ParameterNotes(unit="N m/rad", least=0.0, is_live=True)
    expected = "unit: N m/rad; at least: 0.0; takes effect: between callbacks"
    assert notes.text(has_range_field=False) == expected
    both = ParameterNotes(least=0, most=3, is_live=False)
    assert both.text(has_range_field=True) == "takes effect: at configure"


LIMITED = ParameterNotes(least=0.0, most=2.0, unit="m")


@pytest.mark.parametrize("value", [0.0, 2, 1.5, [0.0, 2.0], (), True, "text"])
def test_values_within_the_limits(value: object) -> None:
    assert LIMITED.fault(value) is None


@pytest.mark.parametrize(
    ("notes", "value", "fault"),
    [
        (LIMITED, 2.5, "is 2.5 m, expected 0.0 to 2.0"),
        (LIMITED, -1, "is -1 m, expected 0.0 to 2.0"),
        (LIMITED, [1.0, 9.0], "has 9.0 m, expected 0.0 to 2.0"),
        (LIMITED, float("nan"), "is nan, expected a finite number"),
        (ParameterNotes(), float("inf"), "is inf, expected a finite number"),
        (ParameterNotes(least=1), 0, "is 0, expected at least 1"),
        (ParameterNotes(most=1), 2, "is 2, expected at most 1"),
        (ParameterNotes(choices=("walk", "stand")), "wlak", "did you mean `walk`?"),
    ],
)
def test_values_beyond_the_limits(notes: ParameterNotes, value: object, fault: str) -> None:
    assert fault in str(notes.fault(value))


def test_the_values_of_an_enum_are_listed_once() -> None:
    fault = ParameterNotes(choices=("walk", "stand")).fault("fly")
    assert fault == "is `fly`, expected one of `walk`, `stand`"
