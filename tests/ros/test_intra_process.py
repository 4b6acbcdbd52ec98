"""Messages within a process bypass DDS if all receivers are inside, and arrive exactly once."""

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Int64

from obelisk_py.core.executor import EventLoopExecutor
from obelisk_py.core.intra_process import IntraProcessPublisher, MessageBuffer
from obelisk_py.core.lifecycle import GuardedLifecycleNode

from .executor_world import DEADLINE_S, World, eventually, world
from .numbers_peer import DEPTH

pytestmark = pytest.mark.ros

PEER = Path(__file__).with_name("numbers_peer.py")
PERIOD_S = 0.001


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The numbers that the library's publishers sent through DDS."""
    numbers: list[int] = []
    send = IntraProcessPublisher._send

    def note(publisher: IntraProcessPublisher, message: Any) -> None:
        numbers.append(message.data)
        send(publisher, message)

    monkeypatch.setattr(IntraProcessPublisher, "_send", note)
    return numbers


class Numbered:
    """Publishes 0, 1, 2, ... on `/numbers`."""

    def __init__(self, made: World) -> None:
        node = made.adopt(GuardedLifecycleNode("source", context=made.context))
        self.count = 0
        self.publisher = node.create_lifecycle_publisher(Int64, "numbers", DEPTH)
        self.publisher.on_activate(None)
        self._over = threading.Event()

    @property
    def buffers(self) -> tuple[MessageBuffer, ...]:
        """The number of subscriptions that need no DDS."""
        return self.publisher._topic.buffers

    def publish(self, count: int = 1) -> None:
        """Publish the next numbers."""
        for _ in range(count):
            self.publisher.publish(Int64(data=self.count))
            self.count += 1

    @contextmanager
    def publishing(self) -> Iterator[None]:
        """Publish numbers one after another, from a separate thread."""
        self._over.clear()

        def run() -> None:
            while not self._over.wait(PERIOD_S):
                self.publish()

        self._thread = threading.Thread(target=run)
        self._thread.start()
        try:
            yield
        finally:
            self.stop()

    def stop(self) -> int:
        """Stop publishing; return the last number, which may still be in transit."""
        self._over.set()
        self._thread.join()
        return self.count - 1


def listener(node: Node, **options: Any) -> list[int]:
    """The list of numbers that a new subscription receives."""
    numbers: list[int] = []

    def receive(message: Int64) -> None:
        numbers.append(message.data)

    node.create_subscription(Int64, "/numbers", receive, DEPTH, **options)
    return numbers


def settle(made: World, source: Numbered, count: int = 1) -> None:
    """Let the executor find this number of subscriptions, for which DDS must hold nothing."""

    def is_settled() -> bool:
        made.executor.spin_once(timeout_sec=0)
        return is_read(source, count)

    eventually(is_settled, f"{count} subscriptions")


def is_read(source: Numbered, count: int = 1) -> bool:
    """Whether this number of subscriptions needs no DDS, and DDS holds nothing for them."""
    buffers = source.buffers
    return len(buffers) == count and not any(buffer.dds_may_hold_messages for buffer in buffers)


def test_without_an_outside_subscriber_no_message_uses_dds(sent: list[int]) -> None:
    with world() as made:
        source = Numbered(made)
        received = [listener(made.node("one")), listener(made.node("other"))]
        settle(made, source, 2)
        source.publish(10)
        made.run_until(lambda: all(len(each) == 10 for each in received), "all messages")
    assert received == [list(range(10))] * 2
    assert not sent


def test_an_outside_subscriber_joins_and_leaves_and_each_end_gets_each_message_once(
    sent: list[int],
) -> None:
    with world() as made:
        source = Numbered(made)
        received = listener(made.node())
        settle(made, source)

        def are_past_dds() -> bool:
            before, enough = len(sent), source.count + 50
            eventually(lambda: source.count > enough, "more numbers")
            return len(sent) == before

        with made.spinning():
            with source.publishing():
                for count in (100, 300):
                    eventually(are_past_dds, "numbers that DDS has no part in")
                    numbers = outside(count)
                    assert numbers == list(range(numbers[0], numbers[0] + count))
                    assert set(numbers) <= set(sent)
                eventually(are_past_dds, "numbers that DDS has no part in any more")
            eventually(lambda: len(received) >= source.count, "all messages")
    assert received == list(range(source.count))


def outside(count: int) -> list[int]:
    """The numbers that a subscriber in another process received before it ended."""
    command = [sys.executable, PEER, "/numbers", str(count)]
    ended = subprocess.run(command, capture_output=True, timeout=2 * DEADLINE_S, check=True)
    numbers: list[int] = json.loads(ended.stdout)
    return numbers


def test_the_order_is_kept_while_messages_wait_on_both_ways(sent: list[int]) -> None:
    with world() as made:
        source = Numbered(made)
        received = listener(made.node())
        settle(made, source)
        source.publish(3)
        # It is not running: for the publisher it is an outside subscription, matched immediately.
        outsider = Node("outsider", context=made.context)
        outsider.create_subscription(Int64, "/numbers", print, 1)
        source.publish(3)
        outsider.destroy_node()
        source.publish(3)
        assert sent == [3, 4, 5, 6, 7, 8]
        with made.spinning():
            eventually(lambda: len(received) == 9, "all messages")
            assert received == list(range(9))

            def is_past_dds() -> bool:
                before = len(sent)
                source.publish()
                return len(sent) == before

            eventually(is_past_dds, "a message that DDS has no part in")


def test_no_message_overtakes_earlier_ones_to_an_unknown_subscription(
    sent: list[int],
) -> None:
    with world() as made:
        source = Numbered(made)
        received = listener(made.node())
        source.publish(3)
        made.executor.remove_node(made.node("passing"))  # makes it check the entities of its nodes
        assert source.buffers
        source.publish(3)
        made.run_until(lambda: len(received) == 6, "all messages")
    assert received == sent == list(range(6))


def test_an_executor_of_another_thread_is_reported(sent: list[int]) -> None:
    with world() as made:
        source = Numbered(made)
        other = EventLoopExecutor(context=made.context)
        node = Node("other", context=made.context)
        other.add_node(node)
        received = listener(node)
        thread = threading.Thread(target=other.spin)
        thread.start()
        try:
            eventually(lambda: is_read(source), "the other executor's subscription")
            source.publish(10)
            eventually(lambda: len(received) == 10, "all messages")
        finally:
            other.shutdown()
            thread.join()
            node.destroy_node()
    assert received == list(range(10))
    assert not sent


def test_a_reentrant_group_receives_each_message_once(sent: list[int]) -> None:
    with world(num_threads=3) as made:
        source = Numbered(made)
        received = listener(made.node(), callback_group=ReentrantCallbackGroup())
        settle(made, source)
        with made.spinning():
            source.publish(300)
            eventually(lambda: len(received) >= 300, "all messages")
    assert sorted(received) == list(range(300))
    assert not sent


def test_a_coroutine_receives_in_order(sent: list[int]) -> None:
    with world() as made:
        source = Numbered(made)
        received: list[int] = []

        async def receive(message: Int64) -> None:
            received.append(message.data)

        made.node().create_subscription(Int64, "/numbers", receive, DEPTH)
        settle(made, source)
        source.publish(10)
        made.run_until(lambda: len(received) == 10, "all messages")
    assert received == list(range(10))
    assert not sent


def test_next_to_a_dds_only_subscription_all_use_dds(sent: list[int]) -> None:
    with world() as made:
        source = Numbered(made)
        node = made.node()
        received = listener(node)
        raw: list[bytes] = []
        infos: list[dict[str, Any]] = []
        node.create_subscription(Int64, "/numbers", raw.append, DEPTH, raw=True)
        node.create_subscription(
            Int64, "/numbers", lambda _message, info: infos.append(info), DEPTH
        )
        settle(made, source)
        source.publish(10)
        made.run_until(lambda: len(received) + len(raw) + len(infos) >= 30, "all messages")
    assert received == sent == list(range(10))
    assert len(raw) == len(infos) == 10
    assert all(info["source_timestamp"] for info in infos)


def test_on_an_executor_of_rclpy_messages_use_dds(sent: list[int]) -> None:
    with world() as made:
        source = Numbered(made)
        node = Node("other", context=made.context)
        received = listener(node)
        executor = SingleThreadedExecutor(context=made.context)
        executor.add_node(node)
        source.publish(10)
        while len(received) < 10:
            executor.spin_once(timeout_sec=DEADLINE_S)
        executor.shutdown()
        node.destroy_node()
    assert received == sent == list(range(10))


def test_publishers_of_rclpy_are_received_too(sent: list[int]) -> None:
    with world() as made:
        source = Numbered(made)
        node = made.node()
        received = listener(node)
        plain = node.create_publisher(Int64, "numbers", DEPTH)
        settle(made, source)
        source.publish(10)
        plain.publish(Int64(data=100))
        source.publish(10)
        made.run_until(lambda: len(received) == 21, "all messages")
    assert [number for number in received if number != 100] == list(range(20))
    assert not sent


def test_messages_waiting_for_a_destroyed_subscription_are_discarded() -> None:
    with world() as made:
        source = Numbered(made)
        node = made.node()
        numbers: list[int] = []
        subscription = node.create_subscription(Int64, "/numbers", numbers.append, DEPTH)
        settle(made, source)
        source.publish(10)
        node.destroy_subscription(subscription)
        received = listener(node)
        settle(made, source)
        source.publish(10)
        made.run_until(lambda: len(received) == 10, "all messages")
    assert received == list(range(10, 20))
    assert not numbers


def test_messages_waiting_without_an_executor_arrive_when_one_runs() -> None:
    with world() as made:
        source = Numbered(made)
        node = made.node()
        received = listener(node)
        settle(made, source)
        source.publish(5)
        made.executor.remove_node(node)
        assert not source.buffers
        source.publish(5)
        made.executor.add_node(node)
        settle(made, source)
        made.run_until(lambda: len(received) == 10, "all messages")
    assert received == list(range(10))
