"""Simulated time at a wall time, from made-up messages."""

import struct
from collections.abc import Iterable

import pytest

from obk_cli.ros.simulated_clock import SimulatedClock

MS = 1_000_000
S = 1000 * MS
BEGIN = 1_700_000_000 * S


def message(time_ns: int) -> bytes:
    return b"\x00\x01\x00\x00" + struct.pack("<iI", *divmod(time_ns, S))


def clock_of(times: Iterable[tuple[int, int]]) -> SimulatedClock:
    """A clock that received these simulated times [ms], each at a time since BEGIN [ms]."""
    clock = SimulatedClock()
    for received_ms, time_ms in times:
        clock.take(BEGIN + received_ms * MS, message(time_ms * MS))
    return clock


def test_the_time_is_the_last_received_one() -> None:
    clock = clock_of((10 * n, 5 * n) for n in range(20))
    assert clock.at(BEGIN + 100 * MS) == 50 * MS
    assert clock.at(BEGIN + 109 * MS) == 50 * MS
    assert clock.at(BEGIN + 900 * MS) == 95 * MS  # a paused simulation


def test_before_the_first_message_no_time_is_known() -> None:
    clock = SimulatedClock()
    clock.take(BEGIN, b"\x00\x01\x00\x00")
    assert clock.at(BEGIN) is None
    assert clock_of([(10, 7)]).at(BEGIN) == 7 * MS


def test_a_time_that_goes_back_starts_a_new_epoch() -> None:
    clock = clock_of([(0, 900), (1, 901), (2, 0), (3, 1)])
    assert clock.epoch == 1
    assert clock.at(BEGIN) == 0
    assert clock.at(BEGIN + 3 * MS) == 1 * MS


def test_the_speed_is_that_at_the_requested_time() -> None:
    assert SimulatedClock().pace(BEGIN) is None
    fast = [(n, n) for n in range(2000)]
    slow = [(2000 + n, 2000 + n // 4) for n in range(2001)]
    clock = clock_of([*fast, *slow])
    assert clock.pace(BEGIN + 2000 * MS) == pytest.approx(0.25, rel=0.01)
    assert clock.pace(BEGIN) == pytest.approx(2500 / 4000, rel=0.01)
    assert clock.pace(BEGIN + 3950 * MS) == 0.0  # a paused simulation


def test_old_times_are_forgotten() -> None:
    clock = clock_of((n, n) for n in range(3000))
    assert clock.at(BEGIN) == 1999 * MS
