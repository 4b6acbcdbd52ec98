"""The kernel timers that the library sets."""

import os
import select
import time
from collections.abc import Iterator

import pytest

from obelisk_py.core.executor.rcl_listeners import arm_timer, open_timer

PERIOD_NS = 1_000_000


@pytest.fixture
def timer_fd() -> Iterator[int]:
    timer_fd = open_timer(time.CLOCK_MONOTONIC)
    yield timer_fd
    os.close(timer_fd)


def expires(timer_fd: int, timeout_s: float) -> bool:
    return bool(select.select([timer_fd], [], [], timeout_s)[0])


def test_a_new_timer_is_not_armed(timer_fd: int) -> None:
    assert not expires(timer_fd, 0.002)


def test_a_periodic_timer_expires_again_once_it_is_read(timer_fd: int) -> None:
    arm_timer(timer_fd, time.monotonic_ns() + PERIOD_NS, PERIOD_NS)
    for _ in range(3):
        assert expires(timer_fd, 5)
        assert int.from_bytes(os.read(timer_fd, 8), "little") >= 1


def test_a_past_time_expires_immediately_and_without_a_period_only_once(timer_fd: int) -> None:
    arm_timer(timer_fd, 1, 0)
    assert expires(timer_fd, 5)
    os.read(timer_fd, 8)
    assert not expires(timer_fd, 0.002)


def test_zero_disarms(timer_fd: int) -> None:
    arm_timer(timer_fd, time.monotonic_ns() + PERIOD_NS, PERIOD_NS)
    arm_timer(timer_fd, 0, 0)
    assert not expires(timer_fd, 0.005)


def test_an_unknown_clock_is_an_os_error() -> None:
    with pytest.raises(OSError, match="Invalid argument"):
        open_timer(99)
