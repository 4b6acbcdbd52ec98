"""Nodes that follow a clock page: their clocks, timers, rates and sleeps."""

import os
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import JumpThreshold, ROSClock
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from obelisk_py.core.clock_page import ClockPage, ClockWriter
from obelisk_py.core.lifecycle import GuardedLifecycleNode
from obelisk_py.core.rate_monitor import RateMonitoredNode
from obelisk_py.core.shared_clock import new_nodes_follow
from obelisk_spec.runtime_protocol import CLOCK_PAGE, ClockDescriptors, clock_page_bytes
from obk_cli.launch.events import ActivationReported
from obk_cli.launch.ros_nodes import subscribe_to_diagnostics

from .executor_world import World, eventually, world

pytestmark = [pytest.mark.ros]

MS = 1_000_000
ON_SIMULATED_TIME = [Parameter("use_sim_time", value=True)]


class Followers:
    """An executor whose nodes follow a page, and the page's writer."""

    def __init__(self, one: World, descriptors: ClockDescriptors) -> None:
        self.world = one
        self.writer = ClockWriter(descriptors)
        self.page = ClockPage(descriptors)
        one.executor.follow(self.page)
        self.now_ns = 0

    def node(self, make: type[GuardedLifecycleNode] = GuardedLifecycleNode) -> Any:
        with new_nodes_follow(self.page):
            node = make("node", context=self.world.context, parameter_overrides=ON_SIMULATED_TIME)
        return self.world.adopt(node)

    def step(self, count: int = 1) -> None:
        for _ in range(count):
            self.now_ns += MS
            self.writer.advance(self.now_ns)


@pytest.fixture(params=[1, 2])
def followers(request: pytest.FixtureRequest) -> Iterator[Followers]:
    page = os.memfd_create(CLOCK_PAGE)
    wakes = (os.eventfd(0, os.EFD_NONBLOCK),)
    os.ftruncate(page, clock_page_bytes(1))
    with world(request.param) as one:
        yield Followers(one, ClockDescriptors(page=page, own=0, wakes=wakes))
    for fd in (page, *wakes):
        os.close(fd)


def test_a_node_reads_the_page_and_does_not_subscribe_to_the_clock(followers: Followers) -> None:
    node = followers.node()
    assert node.get_clock().now().nanoseconds == 0
    followers.step(7)
    assert node.get_clock().now() == Time(
        nanoseconds=7 * MS, clock_type=node.get_clock().clock_type
    )
    assert node.get_clock().ros_time_is_active
    assert "/clock" not in [subscription.topic_name for subscription in node.subscriptions]


def test_a_node_on_wall_time_does_not_follow(followers: Followers) -> None:
    with new_nodes_follow(followers.page):
        node = GuardedLifecycleNode("wall", context=followers.world.context)
    followers.world.adopt(node)
    assert type(node.get_clock()) is ROSClock
    assert node.get_clock().now().nanoseconds > 10**18


def test_a_node_that_leaves_simulated_time_has_wall_time(followers: Followers) -> None:
    node = followers.node()
    node.set_parameters([Parameter("use_sim_time", value=False)])
    assert node.get_clock().now().nanoseconds > 10**18
    node.set_parameters([Parameter("use_sim_time", value=True)])
    followers.step(3)
    assert node.get_clock().now().nanoseconds == 3 * MS


@pytest.mark.parametrize("group", [None, ReentrantCallbackGroup()])
def test_timers_fire_at_each_period_of_simulated_time(followers: Followers, group: Any) -> None:
    node = followers.node()
    followers.step(1000)
    ticks: dict[int, list[int]] = {1: [], 5: []}
    for period_ms, at in ticks.items():

        def tick(at: list[int] = at) -> None:
            at.append(node.get_clock().now().nanoseconds // MS - 1000)

        node.create_timer(period_ms / 1000, tick, callback_group=group)
    with followers.world.spinning():
        for step in range(1, 21):
            followers.step()
            eventually(lambda step=step: len(ticks[1]) == step, "a tick")  # type: ignore[misc]
        eventually(lambda: len(ticks[5]) == 4, "the ticks of the slower timer")
    assert ticks == {1: list(range(1, 21)), 5: [5, 10, 15, 20]}


def test_nothing_fires_while_simulated_time_is_paused(followers: Followers) -> None:
    node = followers.node()
    ticks: list[int] = []
    other: list[None] = []
    node.create_timer(0.001, lambda: ticks.append(1))
    with followers.world.spinning():
        followers.step()
        eventually(lambda: ticks == [1], "the first tick")
        for _ in range(20):
            followers.world.executor.create_task(lambda: other.append(None))
        eventually(lambda: len(other) == 20, "other work")
        assert ticks == [1]


def test_a_timer_can_be_cancelled_and_reset(followers: Followers) -> None:
    node = followers.node()
    ticks: list[int] = []
    timer = node.create_timer(0.005, lambda: ticks.append(node.get_clock().now().nanoseconds // MS))
    probe: list[int] = []
    node.create_timer(0.001, lambda: probe.append(1))

    def step(count: int) -> None:
        for _ in range(count):
            probe.clear()
            followers.step()
            eventually(lambda: probe, "the step")

    with followers.world.spinning():
        step(6)
        assert ticks == [5]
        timer.cancel()
        step(10)
        assert ticks == [5]
        timer.reset()
        assert timer.time_until_next_call() == 5 * MS
        step(4)
        assert ticks == [5]
        step(2)
        eventually(lambda: ticks == [5, 21], "a tick a period after the reset")


def test_late_timers_skip_periods(followers: Followers) -> None:
    node = followers.node(RateMonitoredNode)
    ticks: list[int] = []
    clock = node.get_clock()
    timer = node.create_monitored_timer(
        "timer", 0.001, lambda: ticks.append(clock.now().nanoseconds // MS), group=None, clock=clock
    )
    timer.reset()
    followers.step(10)
    with followers.world.spinning():
        eventually(lambda: ticks == [10], "one tick for all")
        followers.step()
        eventually(lambda: ticks == [10, 11], "the next")


@pytest.mark.parametrize("has_rates", [True, False])
def test_a_node_reports_the_simulated_time_of_its_activation_once(
    followers: Followers, has_rates: bool
) -> None:
    node, listener = followers.node(RateMonitoredNode), followers.node()
    clock = node.get_clock()
    timer = None
    if has_rates:
        timer = node.create_monitored_timer("timer", 1.0, lambda: None, group=None, clock=clock)
    received: list[Any] = []
    subscribe_to_diagnostics(listener, [node.get_fully_qualified_name()], received.append)
    node.trigger_configure()
    followers.step(24)
    if timer is not None:  # its start counts
        timer.reset()
        followers.step(5)
    node.trigger_activate()
    followers.step(100)

    def activations() -> list[Any]:
        return [event for event in received if isinstance(event, ActivationReported)]

    with followers.world.spinning():
        eventually(activations, "the report")
        if has_rates:
            eventually(lambda: len(received) > 2, "a further report")
    assert activations() == [ActivationReported(node="/node", simulated_s=0.024)]


def test_a_node_reports_when_it_has_published_first(followers: Followers) -> None:
    node, listener = followers.node(RateMonitoredNode), followers.node()
    first, second = (node.create_lifecycle_publisher(Clock, name, 1) for name in ("a", "b"))
    received: list[Any] = []
    subscribe_to_diagnostics(listener, [node.get_fully_qualified_name()], received.append)
    node.trigger_configure()
    node.trigger_activate()
    for publisher in (second, first, second):
        followers.step(7)
        publisher.publish(Clock())
    assert "publish" not in {**vars(first), **vars(second)}
    with followers.world.spinning():
        eventually(lambda: received, "the report")
    assert received == [ActivationReported(node="/node", simulated_s=0.0, first_output_s=0.007)]


def test_after_a_jump_back_timers_start_again(followers: Followers) -> None:
    node = followers.node()
    ticks: list[int] = []
    jumps: list[int] = []
    node.create_timer(0.002, lambda: ticks.append(node.get_clock().now().nanoseconds // MS))
    back = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1))
    handle = node.get_clock().create_jump_callback(
        back, post_callback=lambda jump: jumps.append(jump.delta.nanoseconds)
    )
    followers.step(100)
    with followers.world.spinning():
        eventually(lambda: ticks == [100], "a tick")
        followers.now_ns = 0
        followers.writer.restart(0)
        eventually(lambda: jumps == [-100 * MS], "the jump")
        followers.step()
        followers.step()
        eventually(lambda: ticks == [100, 2], "a tick after the jump")
    handle.unregister()


def test_a_rate_and_a_sleep_follow_simulated_time(followers: Followers) -> None:
    node = followers.node()
    woken: list[str] = []

    def sleep() -> None:
        rate = node.create_rate(200.0)
        rate.sleep()
        woken.append("rate")
        assert node.get_clock().sleep_for(Duration(nanoseconds=3 * MS), node.context)
        woken.append("sleep")
        until = Time(seconds=3600, clock_type=node.get_clock().clock_type)
        assert not node.get_clock().sleep_until(until, node.context)
        woken.append("jump")

    thread = threading.Thread(target=sleep)
    with followers.world.spinning():
        thread.start()

        def stepped(count: int) -> bool:
            followers.step()
            return len(woken) == count

        eventually(lambda: stepped(1), "the rate")
        eventually(lambda: stepped(2), "the sleep")
        followers.writer.restart(0)
        eventually(lambda: len(woken) == 3, "the end of a sleep at a jump back")
        thread.join()


def test_a_destroyed_timer_is_not_woken(followers: Followers) -> None:
    node = followers.node()
    gone: list[int] = []
    ticks: list[int] = []
    timer = node.create_timer(0.001, lambda: gone.append(1))
    node.create_timer(0.001, lambda: ticks.append(1))
    with followers.world.spinning():
        followers.step()
        eventually(lambda: gone == [1] == ticks, "a tick of both")
        node.destroy_timer(timer)
        for count in (2, 3, 4):
            followers.step()
            eventually(lambda count=count: len(ticks) == count, "a tick")  # type: ignore[misc]
    assert len(gone) <= 2
