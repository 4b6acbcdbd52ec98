"""The values of a field that a page receives."""

from array import array
from itertools import pairwise

import pytest

from obk_cli.ros.field_path import MISSING
from obk_cli.web.plots import (
    MOST_LINES,
    SAMPLES_HZ,
    SHOWN_S,
    FieldData,
    Trace,
    number_fields,
    numbers_in,
)

from ..ros.definitions import Message, fields_of  # noqa: TID252 - shared by folders of tests

SECOND = 1_000_000_000


def traced(rate_hz: int, seconds: int) -> FieldData:
    trace = Trace()
    for count in range(rate_hz * seconds):
        received_ns = count * SECOND // rate_hz
        if trace.is_due(received_ns):
            trace.take(received_ns, {"x": float(count)})
    return trace.data_after(-1)


def test_a_quick_topic_is_thinned_out() -> None:
    samples = traced(1000, 4).samples
    assert len(samples) == 4 * SAMPLES_HZ
    gaps = {after[0] - before[0] for before, after in pairwise(samples)}
    assert gaps == {SECOND // SAMPLES_HZ}


def test_a_slow_topic_is_kept_whole() -> None:
    assert [values for _, values in traced(5, 2).samples] == [(float(n),) for n in range(10)]


def test_old_values_are_forgotten() -> None:
    samples = traced(10, 100).samples
    assert samples[-1][0] - samples[0][0] == SHOWN_S * SECOND


def test_only_new_values_are_reported() -> None:
    trace = Trace()
    trace.take(5, {"x": 1.0})
    trace.take(7, {"x": 2.0})
    assert trace.data_after(5).samples == ((7, (2.0,)),)
    assert trace.data_after(7).samples == ()


def test_messages_without_a_number_are_reported_until_one_has_it() -> None:
    trace = Trace()
    trace.take(5, {})
    assert trace.data_after(0).fault == "the latest message has no number in this field"
    trace.take(7, {"x": 2.0})
    assert not trace.data_after(0).fault


def test_an_array_may_grow_and_shrink() -> None:
    trace = Trace()
    for at, count in enumerate((1, 3, 2)):
        trace.take(at, {f"q[{place}]": float(place) for place in range(count)})
    received = trace.data_after(-1)
    assert received.labels == ("q[0]", "q[1]", "q[2]")
    assert [values for _, values in received.samples] == [(0.0,), (0.0, 1.0, 2.0), (0.0, 1.0, None)]


def test_of_many_lines_the_first_are_drawn() -> None:
    trace = Trace()
    trace.take(0, {f"q[{place}]": 0.0 for place in range(3 * MOST_LINES)})
    assert len(trace.data_after(-1).labels) == MOST_LINES


@pytest.mark.parametrize(
    ("value", "numbers"),
    [
        (1.5, {"q": 1.5}),
        (True, {"q": 1.0}),
        (array("d", [1.0, 2.0]), {"q[0]": 1.0, "q[1]": 2.0}),
        ([3, 4], {"q[0]": 3.0, "q[1]": 4.0}),
        (b"\x07", {"q": 7.0}),
        (Message(x=1.0, y=2.0), {"q.x": 1.0, "q.y": 2.0}),
        ("text", {}),
        (array("d"), {}),
        (MISSING, {}),
    ],
)
def test_numbers_are_found_with_their_names(value: object, numbers: dict[str, float]) -> None:
    assert numbers_in(value, "q") == numbers


def test_a_long_array_returns_its_first_numbers() -> None:
    assert len(numbers_in(array("B", bytes(1_000_000)), "data")) == MOST_LINES


def test_the_fields_that_can_be_drawn_are_offered() -> None:
    assert number_fields("pkg/State", fields_of) == (
        "header.stamp",
        "header.stamp.sec",
        "header.stamp.nanosec",
        "q_joints",
        "gains",
        "few",
        "is_on",
        "count",
        "mark",
    )


def test_of_messages_within_messages_four_levels_are_offered() -> None:
    link = {"length": "float64", "next": "pkg/Link"}
    assert number_fields("pkg/Link", lambda _: link) == (
        "length",
        "next.length",
        "next.next.length",
        "next.next.next.length",
    )
