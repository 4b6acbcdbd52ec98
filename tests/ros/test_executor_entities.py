"""Entities are created and destroyed while the executor runs, even in their own callbacks."""

import gc
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from obelisk_py.core.executor import EventLoopExecutor

from .executor_world import DEADLINE_S, World, eventually, world

pytestmark = pytest.mark.ros

ROUNDS = 1_000


@pytest.fixture
def one() -> Iterator[World]:
    with world() as made:
        yield made


def open_fds() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def test_a_timer_that_destroys_itself_ticks_once(one: World) -> None:
    node = one.node()
    ticks: list[int] = []

    def tick() -> None:
        ticks.append(1)
        node.destroy_timer(timer)

    timer = node.create_timer(0.001, tick)
    others: list[int] = []
    node.create_timer(0.001, lambda: others.append(1))
    one.run_until(lambda: len(others) > 20, "ticks of another timer")
    assert len(ticks) == 1


def test_a_subscription_that_destroys_itself_receives_no_waiting_messages(one: World) -> None:
    node = one.node()
    received: list[str] = []

    def receive(message: String) -> None:
        received.append(message.data)
        node.destroy_subscription(subscription)

    subscription = node.create_subscription(String, "topic", receive, 10)
    publisher = node.create_publisher(String, "topic", 10)
    for number in range(5):
        publisher.publish(String(data=str(number)))
    later: list[int] = []

    def tick() -> None:
        if received:
            later.append(1)

    node.create_timer(0.01, tick)
    one.run_until(lambda: len(later) > 3, "ticks after the first message")
    assert received == ["0"]


def test_entities_destroyed_by_one_callback_are_not_seen_by_another(one: World) -> None:
    node = one.node()
    alive: set[int] = set()
    faults: list[int] = []
    rounds = [0]
    made: list[Any] = []

    def tick(number: int) -> None:
        if number not in alive:
            faults.append(number)

    def churn() -> None:
        rounds[0] += 1
        for timer in made:
            node.destroy_timer(timer)
        made.clear()
        alive.clear()
        for n in range(5):
            alive.add(rounds[0] * 10 + n)
            made.append(node.create_timer(0.001, lambda number=rounds[0] * 10 + n: tick(number)))

    node.create_timer(0.003, churn)
    one.run_until(lambda: rounds[0] > 50, "50 rounds")
    assert not faults


def test_a_service_may_make_and_destroy_entities_and_even_itself(one: World) -> None:
    node = one.node()
    received: list[str] = []
    kept: dict[str, Any] = {}

    def wire(_request: Any, response: Any) -> Any:
        if kept:
            node.destroy_subscription(kept.pop("subscription"))
            node.destroy_timer(kept.pop("timer"))
            node.destroy_publisher(kept.pop("publisher"))
        publisher = node.create_publisher(String, "topic", 10)
        kept["publisher"] = publisher
        kept["subscription"] = node.create_subscription(
            String, "topic", lambda m: received.append(m.data), 10
        )
        kept["timer"] = node.create_timer(0.001, lambda: publisher.publish(String(data="x")))
        response.success = True
        return response

    def end(_request: Any, response: Any) -> Any:
        node.destroy_service(ending)
        return response

    node.create_service(Trigger, "wire", wire)
    ending = node.create_service(Trigger, "end", end)
    asker = one.node("asker")
    rewire, finish = asker.create_client(Trigger, "wire"), asker.create_client(Trigger, "end")
    assert rewire.wait_for_service(DEADLINE_S)
    assert finish.wait_for_service(DEADLINE_S)
    with one.spinning():
        for _ in range(10):
            received.clear()
            future = rewire.call_async(Trigger.Request())
            eventually(future.done, "the answer")
            eventually(lambda: received, "messages of the new wiring")
        finish.call_async(Trigger.Request())
        eventually(lambda: ending not in list(node.services), "the end of the service")
        received.clear()
        eventually(lambda: received, "messages after the end of the service")


def _timer(node: Node) -> Callable[[], object]:
    timer = node.create_timer(1.0, lambda: None)
    return lambda: node.destroy_timer(timer)


def _subscription(node: Node) -> Callable[[], object]:
    subscription = node.create_subscription(String, "topic", lambda _message: None, 1)
    return lambda: node.destroy_subscription(subscription)


def _service(node: Node) -> Callable[[], object]:
    service = node.create_service(Trigger, "service", lambda _request, response: response)
    return lambda: node.destroy_service(service)


def _client(node: Node) -> Callable[[], object]:
    client = node.create_client(Trigger, "service")
    return lambda: node.destroy_client(client)


def _guard(node: Node) -> Callable[[], object]:
    guard = node.create_guard_condition(lambda: None)
    return lambda: node.destroy_guard_condition(guard)


@pytest.mark.slow
def test_a_thousand_rounds_of_every_entity_leak_no_descriptor(one: World) -> None:
    node = one.node()
    makers = (_timer, _subscription, _service, _client, _guard)
    done: list[int] = []
    undo: list[Callable[[], object]] = []
    after: list[int] = []

    def churn() -> None:
        for destroy in undo:
            destroy()
        undo.clear()
        if len(done) == ROUNDS:
            after.append(open_fds())
            beat.cancel()
            return
        if len(done) == 1:
            after.append(open_fds())
        undo.append(makers[len(done) % len(makers)](node))
        done.append(1)

    beat = node.create_timer(0.0005, churn)
    one.run_until(lambda: len(after) == 2, f"{ROUNDS} rounds")
    # Counted in callbacks, so what the last one destroyed may still be open.
    assert after[1] <= after[0] + 2


def test_created_and_destroyed_nodes_leak_no_descriptor(one: World) -> None:
    one.node()
    counts = []
    with one.spinning():
        for _ in range(10):
            node = Node("passing", context=one.context)
            ticks: list[int] = []
            node.create_timer(0.001, lambda ticks=ticks: ticks.append(1))
            one.executor.add_node(node)
            eventually(lambda ticks=ticks: ticks, "a tick of the added node")
            one.executor.remove_node(node)
            node.destroy_node()
            one.executor.create_task(lambda: counts.append(open_fds()))
        eventually(lambda: len(counts) == 10, "ten counts")
    assert counts[-1] <= counts[1] + 2


def test_after_shutdown_neither_descriptor_nor_thread_is_left() -> None:
    with world() as made:
        node = made.node()
        node.create_timer(0.001, lambda: None)
        made.executor.spin_once(1)
        before_fds, before_threads = open_fds(), threading.active_count()
        for _ in range(20):
            executor = EventLoopExecutor(2, context=made.context)
            executor.add_node(node)
            executor.spin_once(1)
            executor.shutdown()
            made.executor.add_node(node)
        assert open_fds() <= before_fds
        assert threading.active_count() <= before_threads


def test_a_shutdown_within_a_callback_leaks_no_descriptor() -> None:
    with world() as made:
        node = Node("node", context=made.context)
        before_fds = open_fds()
        executor = EventLoopExecutor(2, context=made.context)
        executor.add_node(node)
        node.create_timer(0.001, executor.shutdown)
        executor.spin()
        assert open_fds() <= before_fds
        node.destroy_node()


def test_an_unreferenced_executor_releases_everything() -> None:
    with world() as made:
        executor = EventLoopExecutor(context=made.context)
        node = Node("node", context=made.context)
        executor.add_node(node)
        node.create_timer(0.001, lambda: None)
        before_threads = threading.active_count()
        executor.spin_once(1)
        before_fds = open_fds()
        reference = weakref.ref(executor)
        del executor
        gc.collect()
        assert reference() is None
        assert open_fds() < before_fds
        assert threading.active_count() <= before_threads
        node.destroy_node()


@pytest.mark.parametrize("num_threads", [1, 2])
def test_a_removed_node_is_released_without_another_spin(num_threads: int) -> None:
    with world(num_threads) as made:
        node = Node("node", context=made.context)
        made.executor.spin_once(0)
        before_fds = open_fds()
        made.executor.add_node(node)
        ticks: list[int] = []
        group = MutuallyExclusiveCallbackGroup()
        timer = node.create_timer(0.001, lambda: ticks.append(1), callback_group=group)
        made.executor.spin_once(0.01)
        made.executor.remove_node(node)
        eventually(lambda: open_fds() <= before_fds, "the end of what stood for the node")
        ticks.clear()
        made.executor.add_node(node)
        timer.reset()
        made.run_until(lambda: ticks, "ticks after the node was added again")
        node.destroy_node()


def test_a_guard_condition_that_was_triggered_and_destroyed_calls_nothing(one: World) -> None:
    node = one.node()
    called: list[int] = []
    guard = node.create_guard_condition(lambda: called.append(1))
    one.executor.spin_once(0.01)
    guard.trigger()
    time.sleep(0.05)  # for the thread that waits for it
    node.destroy_guard_condition(guard)
    later: list[int] = []
    node.create_timer(0.001, lambda: later.append(1))
    one.run_until(lambda: len(later) > 3, "later ticks")
    assert not called


def test_entities_of_reentrant_groups_may_be_destroyed_while_other_threads_run_them() -> None:
    with world(num_threads=3) as made:
        node = made.node()
        group = ReentrantCallbackGroup()
        rounds = [0]
        timers: list[Any] = []

        def churn() -> None:
            rounds[0] += 1
            for timer in timers:
                node.destroy_timer(timer)
            timers[:] = [
                node.create_timer(0.0005, lambda: None, callback_group=group) for _ in range(4)
            ]

        node.create_timer(0.002, churn)
        made.run_until(lambda: rounds[0] > 200, "200 rounds")
