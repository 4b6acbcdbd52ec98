"""Timers and rates in lockstep: all clocks; canceled, reset and late timers; new periods."""

from collections.abc import Callable
from typing import Any

import pytest
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.parameter import Parameter

from obelisk_py.core.lockstep.scheduler import TimingModel

from .world import World, seconds

pytestmark = pytest.mark.ros

CLOCKS = (ClockType.ROS_TIME, ClockType.STEADY_TIME, ClockType.SYSTEM_TIME)


@pytest.mark.parametrize("kind", CLOCKS)
def test_a_timer_of_any_clock_is_on_simulated_time(world: World, kind: ClockType) -> None:
    node = world.node()
    times: list[float] = []
    own = Clock(clock_type=kind)
    node.create_timer(0.1, lambda: times.append(own.now().nanoseconds / 1e9), clock=own)
    world.run(0.35)
    assert times == [0.1, 0.2, 0.3]


@pytest.mark.parametrize("group", [MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup])
def test_callback_groups_are_accepted_and_callbacks_never_overlap(
    world: World, group: Callable[[], Any]
) -> None:
    node = world.node()
    inside: list[int] = []
    most: list[int] = []

    def tick() -> None:
        inside.append(1)
        most.append(len(inside))
        inside.pop()

    own = group()
    for _ in range(3):
        node.create_timer(0.01, tick, callback_group=own)
    world.run(0.05)
    assert most == [1] * 15


def test_timers_due_together_run_in_order_of_creation(world: World) -> None:
    one, two = world.node("one"), world.node("two")
    seen: list[str] = []
    two.create_timer(0.02, lambda: seen.append("two, 20 ms"))
    one.create_timer(0.01, lambda: seen.append("one, 10 ms"))
    world.run(0.02)
    assert seen == ["one, 10 ms", "two, 20 ms", "one, 10 ms"]


def test_a_timer_cancels_and_resets_itself(world: World) -> None:
    node = world.node()
    times: list[float] = []

    def tick() -> None:
        times.append(seconds(node))
        if len(times) == 2:
            timer.cancel()
            assert timer.is_canceled()
            assert timer.time_until_next_call() is None
        if len(times) == 4:
            timer.reset()

    timer = node.create_timer(0.1, tick)
    world.run(0.5)
    assert times == [0.1, 0.2]
    world.at(node, 0.55, timer.reset)
    world.run(0.5)
    assert times == [0.1, 0.2, 0.65, 0.75, 0.85, 0.95]
    assert node.destroy_timer(timer)
    world.run(0.5)
    assert len(times) == 6


def test_a_timer_that_is_reset_all_the_time_never_ticks(world: World) -> None:
    node = world.node()
    times: list[float] = []
    slow = node.create_timer(0.1, lambda: times.append(seconds(node)))
    fast = node.create_timer(0.05, slow.reset)
    world.run(1.0)
    assert not times
    fast.cancel()
    world.run(0.25)
    assert times == [1.1, 1.2]


def test_a_period_changes_with_the_next_call(world: World) -> None:
    node = world.node()
    times: list[float] = []
    timer = node.create_timer(0.1, lambda: times.append(seconds(node)))
    world.run(0.15)
    timer.timer_period_ns = 50_000_000
    world.run(0.15)
    assert times == [0.1, 0.2, 0.25, 0.3]


def test_a_timer_without_autostart_waits_for_its_reset(world: World) -> None:
    node = world.node()
    times: list[float] = []
    timer = node.create_timer(0.1, lambda: times.append(seconds(node)), autostart=False)
    world.run(0.5)
    assert not times
    timer.reset()
    world.run(0.1)
    assert times == [0.6]


def test_missed_periods_are_left_out(world: World) -> None:
    node = world.node()
    times: list[float] = []

    def tick() -> None:
        times.append(seconds(node))
        if len(times) == 1:
            node.get_clock().sleep_for(Duration(seconds=0.035))

    node.create_timer(0.01, tick)
    world.run(0.07)
    assert times == [0.01, 0.045, 0.05, 0.06, 0.07]


def test_computing_time_makes_a_node_late_and_no_other(world: World) -> None:
    slow, quick = world.node("slow", compute_s=0.015), world.node("quick")
    ticks: dict[str, list[float]] = {"slow": [], "quick": []}
    for node in (slow, quick):
        node.create_timer(0.01, lambda n=node: ticks[n.get_name()].append(seconds(n)))
    world.run(0.06)
    assert ticks["quick"] == [0.01, 0.02, 0.03, 0.04, 0.05, 0.06]
    assert ticks["slow"] == [0.01, 0.025, 0.04, 0.055]


def test_phases_are_drawn_by_the_seed(make_world: Callable[..., World]) -> None:
    def first_ticks(seed: int) -> list[float]:
        world = make_world(seed=seed, timing=TimingModel(random_phases=True))
        node = world.node()
        ticks: list[float] = []
        for period in (0.01, 0.02):
            node.create_timer(period, lambda: ticks.append(seconds(node)))
        world.run(0.02)
        return ticks

    assert first_ticks(1) == first_ticks(1) != first_ticks(2)


def test_a_rate_takes_the_callback_to_the_next_period(world: World) -> None:
    node = world.node()
    times: list[float] = []

    def tick() -> None:
        rate = node.create_rate(100.0)
        for _ in range(3):
            rate.sleep()
            times.append(seconds(node))
        node.destroy_rate(rate)

    world.at(node, 0.5, tick)
    world.run(1.0)
    assert times == [0.51, 0.52, 0.53]
    assert len(world.notes) == 1
    assert "test_timers.py:" in world.notes[0]


def test_simulated_time_by_parameter_changes_nothing(world: World) -> None:
    times: dict[bool, list[float]] = {True: [], False: []}
    for is_set in times:
        node = world.node(f"node_{is_set}".lower())
        node.set_parameters([Parameter("use_sim_time", value=is_set)])
        node.create_timer(0.1, lambda n=node, s=is_set: times[s].append(seconds(n)))
    world.run(0.5)
    assert times[True] == times[False] == [0.1, 0.2, 0.3, 0.4, 0.5]
