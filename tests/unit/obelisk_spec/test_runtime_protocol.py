"""Rates on /diagnostics survive conversion to a status; foreign web requests are detected."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obelisk_spec.runtime_protocol import (
    REJECTION,
    STANDINGS,
    Rate,
    hz,
    parse_rate,
    parse_rejection,
    rate_name,
    rate_values,
    rejection_values,
)

RATE = Rate(
    name="timer_ctrl",
    expected_hz=1000.0,
    measured_hz=187.5,
    ticks=4211,
    overruns=3,
    late_p50_us=81.9,
    late_p99_us=2752.5,
    late_max_us=130023.4,
    standing="broken",
)


def test_a_rate_round_trips() -> None:
    name = rate_name("/arm/controller", RATE.name)
    assert name == "arm/controller: timer_ctrl"
    assert parse_rate(name, 2, dict(rate_values(RATE))) == RATE


def test_the_period_is_reported_too() -> None:
    assert dict(rate_values(RATE))["period_sec"] == "0.001"


@pytest.mark.parametrize("standing", STANDINGS)
def test_the_level_is_the_standing(standing: str) -> None:
    rate = parse_rate("a: b", STANDINGS.index(standing), dict(rate_values(RATE)))  # type: ignore[arg-type]
    assert rate is not None
    assert rate.standing == standing


@pytest.mark.parametrize(
    ("name", "level", "more"),
    [
        ("motor temperature", 0, {}),
        ("a: b", 3, {}),
        ("a: b", 0, {"expected_hz": "much"}),
        ("a: b", 0, {"expected_hz": "0"}),
        ("a: b", 0, {"measured_hz": "nan"}),
        ("a: b", 0, {"late_p99_us": "inf"}),
        ("a: b", 0, {"ticks": "1.5"}),
    ],
)
def test_an_invalid_rate_is_none(name: str, level: int, more: dict[str, str]) -> None:
    assert parse_rate(name, level, {**dict(rate_values(RATE)), **more}) is None


def test_a_status_of_other_tools_is_none() -> None:
    assert parse_rate("lidar: temperature", 1, {"celsius": "41"}) is None


@given(st.text(), st.integers(), st.dictionaries(st.text(), st.text()))
def test_any_other_status_is_none(name: str, level: int, values: dict[str, str]) -> None:
    assert parse_rate(name, level, values) is None


def test_rejected_commands_are_read_as_they_were_reported() -> None:
    name = rate_name("/arm/robot", REJECTION)
    assert parse_rejection(name, dict(rejection_values(2.5, "`u` is nan"))) == (2.5, "`u` is nan")


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("a: timer", {"seconds": "1", "reason": "x"}),
        (f"a: {REJECTION}", {"seconds": "long", "reason": "x"}),
        (f"a: {REJECTION}", {"reason": "x"}),
    ],
)
def test_a_status_of_another_kind_reports_no_rejected_commands(
    name: str, values: dict[str, str]
) -> None:
    assert parse_rejection(name, values) is None


@pytest.mark.parametrize(
    ("rate_hz", "text"), [(20_000.0, "20000"), (999.96, "1000"), (463.42, "463.4"), (0.5, "0.5")]
)
def test_a_rate_is_shown_without_an_exponent(rate_hz: float, text: str) -> None:
    assert hz(rate_hz) == text
