"""A launch that ends after simulated seconds, counted on the simulator's clock page."""

import os
import threading
from collections.abc import Iterator

import pytest

from obelisk_py.core.clock_page import ClockWriter
from obelisk_spec.runtime_protocol import CLOCK_PAGE, ClockDescriptors, clock_page_bytes
from obk_cli.errors import MisuseError
from obk_cli.launch.events import Phase
from obk_cli.launch.options import require_simulated_time
from obk_cli.launch.process_groups import share_of
from obk_cli.launch.simulated_duration import SimulatedDuration, counting
from obk_cli.plan.plan import Plan

from ....waiting import DEADLINE_S  # noqa: TID252 - shared by folders of tests
from ..plans import node  # noqa: TID252 - shared by folders of tests

S = 1_000_000_000
ACTIVE = Phase(name="active", seconds=1.0)


@pytest.fixture
def clock() -> Iterator[ClockDescriptors]:
    """A page with a slot for a node and one for the launcher."""
    page = os.memfd_create(CLOCK_PAGE)
    wakes = tuple(os.eventfd(0, os.EFD_NONBLOCK) for _ in range(2))
    os.ftruncate(page, clock_page_bytes(2))
    yield ClockDescriptors(page=page, own=1, wakes=wakes)
    for fd in (page, *wakes):
        os.close(fd)


class Counted:
    """A simulator and a counter of its seconds, starting at 3 s, when the stack becomes active."""

    def __init__(self, clock: ClockDescriptors, duration_s: float) -> None:
        self.simulator = ClockWriter(clock)
        self.over = threading.Event()
        self.duration = SimulatedDuration(clock, duration_s, self.over.set)
        self.simulator.advance(3 * S)
        self.duration.on_event(Phase(name="ready", seconds=0.0))
        self.duration.on_event(ACTIVE)


def test_the_end_is_reported_at_the_step_that_reaches_it(clock: ClockDescriptors) -> None:
    counted = Counted(clock, 2.0)
    counted.simulator.advance(4 * S)
    counted.simulator.advance(5 * S)
    assert counted.over.wait(DEADLINE_S)


def test_time_before_the_stack_is_active_does_not_count(clock: ClockDescriptors) -> None:
    counted = Counted(clock, 2.0)
    counted.simulator.advance(5 * S - 1)
    counted.duration.close()
    assert not counted.over.is_set()


def test_a_reset_of_the_simulation_starts_the_count_again(clock: ClockDescriptors) -> None:
    counted = Counted(clock, 2.0)
    counted.simulator.advance(4 * S)
    counted.simulator.restart(0)
    now_ns = 0
    while not counted.over.wait(0.01):
        now_ns += S
        counted.simulator.advance(now_ns)
    assert now_ns >= 2 * S


def test_without_a_duration_nothing_is_counted(clock: ClockDescriptors) -> None:
    with counting(clock, None, pytest.fail) as on_event:
        on_event(ACTIVE)
        ClockWriter(clock).advance(S)


def test_a_stack_on_the_wall_clock_has_no_simulated_seconds() -> None:
    hardware = Plan(name="s", nodes=(node("robot", "robot"),))
    on_wall_clock = Plan(name="s", nodes=(node("robot", "robot", model="arm.xml"),))
    for plan in (hardware, on_wall_clock):
        with pytest.raises(MisuseError, match="--sim-duration"):
            require_simulated_time(plan, share_of(plan, None))
