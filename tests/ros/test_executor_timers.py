"""Timers under the event-loop executor: never early, late ones skip, on every clock."""

import itertools
import select
import time
from collections.abc import Iterator
from typing import Any

import pytest
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import String

from obelisk_py.core.executor.handlers import TimerHandler
from obelisk_py.core.executor.rcl_listeners import arm_timer
from obelisk_py.core.executor.worker import Worker

from .executor_world import DEADLINE_S, World, eventually, world

pytestmark = pytest.mark.ros

S_IN_NS = 10**9


@pytest.fixture
def one() -> Iterator[World]:
    with world() as made:
        yield made


@pytest.mark.parametrize("clock_type", [ClockType.STEADY_TIME, ClockType.SYSTEM_TIME])
def test_a_timer_is_never_early_and_stops_while_it_is_cancelled(
    one: World, clock_type: ClockType
) -> None:
    node = one.node()
    clock = Clock(clock_type=clock_type)
    ticks: list[int] = []
    start_ns = clock.now().nanoseconds
    timer = node.create_timer(0.01, lambda: ticks.append(clock.now().nanoseconds), clock=clock)
    others: list[int] = []
    node.create_timer(0.01, lambda: others.append(1))

    def wait_for_others() -> None:
        before = len(others)
        eventually(lambda: len(others) >= before + 5, "ticks of another timer")

    with one.spinning():
        eventually(lambda: len(ticks) >= 10, "ten ticks")
        timer.cancel()
        wait_for_others()  # for a tick that is in progress
        count = len(ticks)
        wait_for_others()
        assert len(ticks) == count
        timer.reset()
        eventually(lambda: len(ticks) > count, "a tick after reset")
    assert all(at >= start_ns + (n + 1) * 10_000_000 for n, at in enumerate(ticks[:10]))


def test_a_timer_that_is_not_started_waits_for_its_reset(one: World) -> None:
    node = one.node()
    ticks: list[int] = []
    timer = node.create_timer(0.005, lambda: ticks.append(1), autostart=False)
    others: list[int] = []
    node.create_timer(0.005, lambda: others.append(1))
    with one.spinning():
        eventually(lambda: len(others) >= 5, "ticks of another timer")
        assert not ticks
        timer.reset()
        eventually(lambda: len(ticks) >= 3, "ticks after reset")


def test_a_timer_takes_a_new_period_and_may_cancel_and_reset_itself(one: World) -> None:
    node = one.node()
    ticks: list[int] = []

    def tick() -> None:
        ticks.append(1)
        if len(ticks) == 1:
            timer.timer_period_ns = 1_000_000
        if len(ticks) == 20:
            timer.cancel()
            timer.reset()
        if len(ticks) == 40:
            timer.cancel()

    # So slow that without the new period it would not reach its 20th tick in time.
    timer = node.create_timer(1.2, tick)
    with one.spinning():
        eventually(lambda: len(ticks) == 40, "40 ticks of a timer that became faster")
        time.sleep(0.02)
    assert len(ticks) == 40


def test_a_timer_without_a_period_is_called_again_and_again(one: World) -> None:
    node = one.node()
    ticks: list[int] = []
    others: list[int] = []
    node.create_timer(0.0, lambda: ticks.append(1))
    node.create_timer(0.01, lambda: others.append(1))
    one.run_until(lambda: len(ticks) > 100 and len(others) > 3, "many calls of both timers")


def test_a_timer_that_another_thread_cancels_when_it_is_due_is_not_called(one: World) -> None:
    node = one.node()
    ticks: list[int] = []
    timer = node.create_timer(0.001, lambda: ticks.append(1))
    handler = TimerHandler(timer, lambda: one.executor)

    class Cancelling:
        """The timer's handle, canceled between the check and the call."""

        def __getattr__(self, name: str) -> Any:
            return getattr(timer.handle, name)

        def time_until_next_call(self) -> int:
            return 0

        def is_timer_ready(self) -> bool:
            timer.cancel()
            return True

    arm_timer(handler._timer_fd, 1, 0)
    select.select([handler._timer_fd], [], [], DEADLINE_S)
    handle, handler._handle = handler._handle, Cancelling()
    assert not handler._run(Worker())
    handler._handle = handle
    handler.close()
    assert not ticks


def test_a_timer_that_another_thread_resets_before_it_is_due_is_not_called(one: World) -> None:
    node = one.node()
    ticks: list[int] = []
    timer = node.create_timer(10.0, lambda: ticks.append(1))
    handler = TimerHandler(timer, lambda: one.executor)

    class Resetting:
        """The timer's handle; the timer was due until it was reset."""

        def __getattr__(self, name: str) -> Any:
            return getattr(timer.handle, name)

        def time_until_next_call(self) -> int:
            return 0

    arm_timer(handler._timer_fd, 1, 0)
    select.select([handler._timer_fd], [], [], DEADLINE_S)
    handle, handler._handle = handler._handle, Resetting()
    assert not handler._run(Worker())
    handler._handle = handle
    handler.close()
    assert not ticks


def test_a_timer_that_was_late_skips_periods_instead_of_catching_up(one: World) -> None:
    node = one.node()
    ticks: list[float] = []

    def tick() -> None:
        ticks.append(time.monotonic())
        if len(ticks) == 3:
            time.sleep(0.3)

    node.create_timer(0.02, tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
    start = time.monotonic()
    one.run_until(lambda: len(ticks) >= 10, "ten ticks")
    assert len(ticks) <= (time.monotonic() - start - 0.28) / 0.02 + 2


def test_simulated_time_drives_timers(one: World) -> None:
    node = one.node(parameter_overrides=[Parameter("use_sim_time", value=True)])
    clock_source = one.node("clock")
    ticks: list[int] = []
    node.create_timer(1.0, lambda: ticks.append(node.get_clock().now().nanoseconds))
    publisher = clock_source.create_publisher(ClockMessage, "/clock", 10)
    now_ns = [0]

    def advance() -> None:
        if node.get_clock().now().nanoseconds == now_ns[0]:  # otherwise the last one is in progress
            now_ns[0] += S_IN_NS // 4
        message = ClockMessage()
        message.clock.sec, message.clock.nanosec = divmod(now_ns[0], S_IN_NS)
        publisher.publish(message)

    clock_source.create_timer(0.002, advance, clock=Clock(clock_type=ClockType.STEADY_TIME))
    one.run_until(lambda: len(ticks) >= 8, "eight simulated seconds")
    steps = [later - earlier for earlier, later in itertools.pairwise(ticks[1:])]
    assert min(steps) >= S_IN_NS // 2
    assert ticks[-1] <= now_ns[0]


def test_a_flood_of_messages_does_not_stop_timers(one: World) -> None:
    node = one.node()
    received, ticks = [0], [0]
    publisher = node.create_publisher(String, "flood", 10)

    def again(_message: String) -> None:
        received[0] += 1
        publisher.publish(String())
        publisher.publish(String())

    node.create_subscription(String, "flood", again, 10)
    node.create_timer(0.002, lambda: ticks.__setitem__(0, ticks[0] + 1))
    publisher.publish(String())
    one.run_until(lambda: received[0] > 500 and ticks[0] > 20, "ticks during the flood")
