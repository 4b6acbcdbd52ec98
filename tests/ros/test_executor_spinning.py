"""Spinning the event-loop executor ends by an exception, a timeout, a future or a shutdown."""

import itertools
import threading
import time
from collections.abc import Iterator

import pytest
from lifecycle_msgs.srv import GetState
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import ExternalShutdownException
from rclpy.task import Future
from std_msgs.msg import String

from .executor_world import DEADLINE_S, World, world

pytestmark = pytest.mark.ros


@pytest.fixture
def one() -> Iterator[World]:
    with world() as made:
        yield made


def test_an_exception_in_a_callback_leaves_spin_which_can_continue(one: World) -> None:
    node = one.node()
    received: list[str] = []

    def receive(message: String) -> None:
        received.append(message.data)
        if message.data == "0":
            raise ValueError("boom")

    node.create_subscription(String, "topic", receive, 10)
    publisher = node.create_publisher(String, "topic", 10)
    for number in range(3):
        publisher.publish(String(data=str(number)))
    with pytest.raises(ValueError, match="boom"):
        one.executor.spin()
    one.run_until(lambda: received == ["0", "1", "2"], "the messages after the one that failed")


@pytest.mark.parametrize("kind", ["timer", "task", "coroutine", "guard", "service"])
def test_exceptions_leave_spin_wherever_they_were_raised(one: World, kind: str) -> None:
    node = one.node()

    def fail(*_args: object) -> None:
        raise ValueError("boom")

    async def fail_later() -> None:
        await future
        raise ValueError("boom")

    future: Future = Future()
    if kind == "timer":
        node.create_timer(0.001, fail)
    elif kind == "task":
        one.executor.create_task(fail)
    elif kind == "coroutine":
        one.executor.create_task(fail_later)
        threading.Timer(0.02, lambda: future.set_result(None)).start()
    elif kind == "guard":
        node.create_guard_condition(fail).trigger()
    else:
        node.create_service(GetState, "state", fail)
        client = node.create_client(GetState, "state")
        assert client.wait_for_service(DEADLINE_S)
        client.call_async(GetState.Request())
    with pytest.raises(ValueError, match="boom"):
        one.executor.spin()


def test_spin_once_runs_one_callback(one: World) -> None:
    node = one.node()
    received: list[str] = []
    node.create_subscription(String, "topic", lambda m: received.append(m.data), 10)
    publisher = node.create_publisher(String, "topic", 10)
    for number in range(3):
        publisher.publish(String(data=str(number)))
    counts = [0]
    end = time.monotonic() + DEADLINE_S
    while len(received) < 3 and time.monotonic() < end:
        one.executor.spin_once(timeout_sec=0.5)
        counts.append(len(received))
    assert received == ["0", "1", "2"]
    assert {later - earlier for earlier, later in itertools.pairwise(counts)} <= {0, 1}


def test_waits_end_at_their_timeout(one: World) -> None:
    one.node()
    start = time.monotonic()
    one.executor.spin_once(timeout_sec=0)
    one.executor.spin_once(timeout_sec=0.05)
    one.executor.spin_until_future_complete(Future(), timeout_sec=0.05)
    one.executor.spin_once_until_future_complete(Future(), timeout_sec=0.05)
    assert time.monotonic() - start >= 0.15


def test_waiting_for_a_future_ends_with_it_and_leaves_nothing_on_it(one: World) -> None:
    one.node()
    never: Future = Future()
    for _ in range(3):
        one.executor.spin_until_future_complete(never, timeout_sec=0)
    assert never._callbacks == []
    for end in (lambda future: future.set_result(1), Future.cancel):
        future: Future = Future()
        timer = threading.Timer(0.02, end, [future])
        timer.start()
        one.executor.spin_until_future_complete(future, timeout_sec=3e8)
        timer.join()
        assert future.done() or future.cancelled()


def test_a_second_spin_of_the_same_executor_is_rejected(one: World) -> None:
    node = one.node()
    refused: list[str] = []

    def nested() -> None:
        try:
            one.executor.spin_once(0)
        except RuntimeError as error:
            refused.append(str(error))

    node.create_timer(0.001, nested)
    one.run_until(lambda: refused, "the refusal")
    assert "already spinning" in refused[0]


def test_the_end_of_the_context_ends_spin(one: World) -> None:
    one.node()
    timer = threading.Timer(0.05, one.context.shutdown)
    timer.start()
    one.executor.spin()
    timer.join()
    with pytest.raises(ExternalShutdownException):
        one.executor.spin_once()


def test_shutdown_within_a_callback_ends_spin(one: World) -> None:
    node = one.node()
    node.create_timer(0.001, one.executor.shutdown)
    one.executor.spin()
    assert one.executor.get_nodes() == []
    one.executor.spin()  # returns immediately
    one.executor.wake()
    assert one.executor.shutdown()


def test_shutdown_reports_of_a_callback_that_takes_too_long(one: World) -> None:
    node = one.node()
    entered, leave = threading.Event(), threading.Event()
    node.create_timer(0.001, lambda: (entered.set(), leave.wait()))
    thread = threading.Thread(target=one.executor.spin)
    thread.start()
    assert entered.wait(DEADLINE_S)
    assert not one.executor.shutdown(timeout_sec=0.05)
    leave.set()
    thread.join()
    assert one.executor.shutdown(timeout_sec=DEADLINE_S)


def test_an_exception_on_another_thread_leaves_spin() -> None:
    with world(num_threads=2) as made:
        node = made.node()

        def fail() -> None:
            raise ValueError("boom")

        node.create_timer(0.01, lambda: None)
        node.create_timer(0.001, fail, callback_group=MutuallyExclusiveCallbackGroup())
        with pytest.raises(ValueError, match="boom"):
            made.executor.spin()
