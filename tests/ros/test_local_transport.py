"""Messages between the processes of a run bypass DDS and arrive once, despite killed processes."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Image
from std_msgs.msg import Int64

from obelisk_py.core.executor import EventLoopExecutor, local_receiver
from obelisk_py.core.intra_process import IntraProcessPublisher
from obelisk_py.core.lifecycle import GuardedLifecycleNode
from obelisk_py.core.local_sender import subscriptions_of
from obelisk_spec.local_transport.dds_reader import DdsReader
from obelisk_spec.runtime_protocol import LOCAL_TRANSPORT_OFF, LOCAL_TRANSPORT_VARIABLE
from obk_cli.ros.raw_subscription import DropCounter, RawSubscription

from .executor_world import DEADLINE_S, World, eventually, world
from .numbers_peer import DEPTH
from .test_intra_process import Numbered

pytestmark = pytest.mark.ros

LOCAL_PEER = Path(__file__).with_name("local_peer.py")
OUTSIDE_PEER = Path(__file__).with_name("numbers_peer.py")


@pytest.fixture(autouse=True)
def sockets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a run, set in the environment."""
    folder = tmp_path / "sockets"
    folder.mkdir(mode=0o700)
    monkeypatch.setenv(LOCAL_TRANSPORT_VARIABLE, str(folder))
    return folder


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The numbers that this process sent through DDS."""
    numbers: list[int] = []
    send = IntraProcessPublisher._send

    def note(publisher: IntraProcessPublisher, message: Any) -> None:
        numbers.append(message.data)
        send(publisher, message)

    monkeypatch.setattr(IntraProcessPublisher, "_send", note)
    return numbers


@dataclass(frozen=True)
class Listener:
    """A subscription in another process."""

    process: "subprocess.Popen[bytes]"
    file: Path

    @property
    def numbers(self) -> list[int]:
        """The numbers received so far."""
        lines = self.file.read_text(encoding="ascii").split("\n")[:-1] if self.file.exists() else []
        return [int(line) for line in lines]

    def has(self, number: int) -> bool:
        return self.numbers[-1:] == [number]


class Peers:
    """Further processes of the run."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._folder = folder
        self._stack = stack
        self._count = 0

    def listener(self, depth: int = DEPTH) -> Listener:
        self._count += 1
        file = self._folder / f"{self._count}.txt"
        return Listener(self._start("listen", "/numbers", str(depth), str(file)), file)

    def publisher(self, first: int) -> "subprocess.Popen[bytes]":
        return self._start("publish", "/numbers", str(first), "0.001")

    def _start(self, *arguments: str) -> "subprocess.Popen[bytes]":
        process = subprocess.Popen([sys.executable, LOCAL_PEER, *arguments])
        self._stack.callback(process.wait)
        self._stack.callback(process.kill)
        return process


@pytest.fixture
def peers(tmp_path: Path) -> Iterator[Peers]:
    with ExitStack() as stack:
        yield Peers(tmp_path, stack)


def outside(count: int) -> list[int]:
    """The numbers that a subscriber outside the run received before it ended."""
    command = [sys.executable, OUTSIDE_PEER, "/numbers", str(count)]
    ended = subprocess.run(command, capture_output=True, timeout=2 * DEADLINE_S, check=True)
    # It may be preceded by Fast DDS errors, such as ports in use.
    numbers: list[int] = json.loads(ended.stdout.splitlines()[-1])
    return numbers


@pytest.fixture(params=[True, False], ids=["on", "off"])
def with_and_without(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, sockets: Path
) -> bool:
    """Run the test with and without the local transport; True with it."""
    del sockets
    if not request.param:
        monkeypatch.setenv(LOCAL_TRANSPORT_VARIABLE, LOCAL_TRANSPORT_OFF)
    return bool(request.param)


@contextmanager
def published(sent: list[int]) -> Iterator[tuple[World, Numbered, Callable[[], None]]]:
    """A publisher that publishes continuously; `last` waits until it bypasses DDS.

    Without the local transport, it only waits for some more numbers.
    """
    is_off = os.environ[LOCAL_TRANSPORT_VARIABLE] == LOCAL_TRANSPORT_OFF
    with world() as made:
        source = Numbered(made)

        def are_past_dds() -> bool:
            before, enough = len(sent), source.count + 50
            eventually(lambda: source.count > enough, "more numbers")
            return is_off or len(sent) == before

        with made.spinning(), source.publishing():
            yield made, source, lambda: eventually(are_past_dds, "numbers past DDS")


def is_gapless(numbers: list[int]) -> bool:
    return numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_subscriptions_of_the_run_need_no_dds(sent: list[int], peers: Peers) -> None:
    with published(sent) as (made, source, await_bypass):
        listeners = [peers.listener(), peers.listener()]
        own: list[int] = []
        made.node("own").create_subscription(
            Int64, "/numbers", lambda message: own.append(message.data), DEPTH
        )
        eventually(lambda: all(each.numbers for each in listeners), "numbers")
        await_bypass()
    last = source.count - 1
    eventually(lambda: all(each.has(last) for each in listeners), "the last number")
    assert all(is_gapless(each.numbers) for each in listeners)
    assert is_gapless(own)


def test_an_outside_subscriber_joins_and_leaves_and_each_end_gets_each_message_once(
    sent: list[int], peers: Peers
) -> None:
    with published(sent) as (_made, source, await_bypass):
        inside = peers.listener()
        eventually(lambda: inside.numbers, "numbers")
        for count in (100, 300):
            await_bypass()
            numbers = outside(count)
            assert numbers == list(range(numbers[0], numbers[0] + count))
            assert set(numbers) <= set(sent)
        await_bypass()
    eventually(lambda: inside.has(source.count - 1), "the last number")
    assert is_gapless(inside.numbers)


@pytest.mark.usefixtures("with_and_without")
def test_a_killed_subscription_disturbs_no_other_and_its_successor_is_found(
    sent: list[int], peers: Peers
) -> None:
    with published(sent) as (_made, source, await_bypass):
        stays, dies = peers.listener(), peers.listener()
        eventually(lambda: stays.numbers and dies.numbers, "numbers")
        await_bypass()
        dies.process.kill()
        await_bypass()
        successor = peers.listener()
        eventually(lambda: successor.numbers, "numbers of the successor")
        await_bypass()
        last = source.stop()  # the publisher must exist until DDS has delivered all
        for each in (stays, successor):
            eventually(lambda each=each: each.has(last), "the last number")
            assert is_gapless(each.numbers)


def test_a_frozen_subscription_keeps_its_depth_and_blocks_no_publisher(
    sent: list[int], peers: Peers, with_and_without: bool
) -> None:
    depth = 20
    with published(sent) as (_made, source, await_bypass):
        frozen, other = peers.listener(depth), peers.listener()
        eventually(lambda: frozen.numbers and other.numbers, "numbers")
        await_bypass()
        frozen.process.send_signal(signal.SIGSTOP)
        enough = source.count + 1000
        eventually(lambda: source.count > enough, "a thousand numbers meanwhile")
        before = len(frozen.numbers)
        frozen.process.send_signal(signal.SIGCONT)
        eventually(lambda: len(frozen.numbers) > before, "numbers again")
        await_bypass()
        last = source.stop()
        eventually(lambda: frozen.has(last) and other.has(last), "the last number")
    assert is_gapless(other.numbers)
    numbers = frozen.numbers
    assert numbers == sorted(set(numbers))
    # DDS also keeps as many messages as the publisher's history.
    assert not with_and_without or len(numbers) < last - 500


@pytest.mark.usefixtures("with_and_without")
def test_messages_of_a_killed_publisher_and_of_its_successor_are_received(peers: Peers) -> None:
    with world() as made:
        got: list[int] = []
        node = made.node()
        node.create_subscription(Int64, "/numbers", lambda message: got.append(message.data), DEPTH)
        with made.spinning():
            first = peers.publisher(0)
            eventually(lambda: len(got) > 500, "numbers")
            first.send_signal(signal.SIGSTOP)
            first.send_signal(signal.SIGCONT)
            enough = len(got) + 100
            eventually(lambda: len(got) > enough, "numbers after the freeze")
            first.kill()
            peers.publisher(1_000_000)
            eventually(lambda: got[-1] > 1_000_500, "numbers of the successor")
    early = [number for number in got if number < 1_000_000]
    assert is_gapless(early)
    assert is_gapless(got[len(early) :])


def test_nothing_is_lost_when_a_node_changes_its_executor(sent: list[int], sockets: Path) -> None:
    with published(sent) as (_made, source, _await_bypass), world() as other:
        got: list[int] = []
        node = Node("moved", context=other.context)
        node.create_subscription(Int64, "/numbers", lambda message: got.append(message.data), DEPTH)
        for _ in range(4):
            executor = EventLoopExecutor(context=other.context)
            executor.add_node(node)
            through_dds = -1
            while through_dds != len(sent):  # until a hundred numbers bypass DDS
                through_dds, enough = len(sent), source.count + 100
                while not got or got[-1] < enough:
                    executor.spin_once(timeout_sec=0.1)
            executor.remove_node(node)
            executor.shutdown()
            assert not list(sockets.iterdir())
        node.destroy_node()
    assert is_gapless(got)


def test_a_node_that_subscribes_twice_gets_each_message_twice(
    sent: list[int], peers: Peers
) -> None:
    with world() as made:
        got: tuple[list[int], list[int]] = [], []
        node = made.node()
        for numbers in got:
            node.create_subscription(
                Int64,
                "/numbers",
                lambda message, numbers=numbers: numbers.append(message.data),
                DEPTH,
            )
        with made.spinning():
            peers.publisher(0)
            eventually(lambda: all(len(numbers) > 300 for numbers in got), "numbers")
    assert all(map(is_gapless, got))


def test_a_large_message_keeps_its_order_between_small_ones(sent: list[int]) -> None:
    del sent
    with world() as made, world() as other:
        got: list[int] = []
        other.node("listener").create_subscription(
            Image, "/images", lambda image: got.append(image.width), DEPTH
        )
        node = made.adopt(GuardedLifecycleNode("source", context=made.context))
        publisher = node.create_lifecycle_publisher(Image, "images", DEPTH)
        publisher.on_activate(None)
        with other.spinning():
            count = 0

            def publish() -> bool:
                nonlocal count
                size = 300_000 if count % 7 == 0 else 10
                publisher.publish(Image(width=count, data=bytes(size)))
                count += 1
                return len(got) > 200

            eventually(publish, "messages")
            eventually(lambda: got[-1] == count - 1, "the last message")
    assert is_gapless(got)


def test_a_tap_counts_each_message_once_while_subscribers_join_and_leave(
    sent: list[int], peers: Peers
) -> None:
    with published(sent) as (_made, source, await_bypass), world() as other:
        node = Node("tap", context=other.context)
        tap = RawSubscription(node.handle, "/numbers", "std_msgs/msg/Int64", Int64)
        drops, got, times = DropCounter(), [-1], [0]
        inside = peers.listener()

        def take(enough: int) -> None:
            while got[-1] < enough:
                for data, info in tap.take():
                    drops.take(info["publication_sequence_number"], 1)
                    got.append(deserialize_message(data, Int64).data)
                    times.append(info["received_timestamp"])

        for _ in range(2):
            through_dds = -1
            while through_dds != len(sent):  # until a hundred numbers bypass DDS
                through_dds = len(sent)
                take(source.count + 100)
            # Messages have the times when they arrived, however late they are taken.
            waiting = got[-1] + 10
            eventually(lambda enough=waiting: source.count > enough + 1, "waiting messages")
            taken_ns = time.time_ns()
            take(waiting)
            assert times[got.index(waiting)] <= taken_ns
            with ThreadPoolExecutor(1) as pool:
                listener = pool.submit(outside, 100)
                while not listener.done():
                    take(source.count)
            assert is_gapless(listener.result())
        take(source.count)
        tap.close()
        await_bypass()  # with `inside` alone
        node.destroy_node()
    eventually(lambda: inside.has(source.count - 1), "the last number")
    assert is_gapless(got[1:])
    assert is_gapless(inside.numbers)
    assert drops.dropped == 0
    assert drops.count == len(got) - 1


def test_if_disabled_everything_uses_dds(
    sent: list[int], peers: Peers, monkeypatch: pytest.MonkeyPatch, sockets: Path
) -> None:
    monkeypatch.setenv(LOCAL_TRANSPORT_VARIABLE, LOCAL_TRANSPORT_OFF)
    with published(sent) as (_made, source, _await_bypass):
        listener = peers.listener()
        eventually(lambda: len(listener.numbers) > 200, "numbers")
        last = source.stop()
        eventually(lambda: listener.has(last), "the last number")
    assert len(sent) == source.count
    assert not list(sockets.iterdir())


def test_a_folder_that_others_can_enter_is_not_used(
    sent: list[int], peers: Peers, sockets: Path
) -> None:
    sockets.chmod(0o750)
    with published(sent) as (_made, source, _await_bypass):
        listener = peers.listener()
        eventually(lambda: len(listener.numbers) > 200, "numbers")
    assert len(sent) == source.count
    assert not list(sockets.iterdir())


def test_threads_that_share_a_publisher_lose_nothing_when_a_subscription_is_killed(
    sent: list[int], peers: Peers
) -> None:
    with published(sent) as (_made, source, await_bypass):
        stays, dies = peers.listener(), peers.listener()
        eventually(lambda: stays.numbers and dies.numbers, "numbers")
        await_bypass()
        source.stop()
        threads, each = 3, 2000
        first = 1_000_000

        def publish(thread: int) -> None:
            for number in range(each):
                source.publisher.publish(Int64(data=first + thread * each + number))
                if thread == 0 and number == each // 2:
                    dies.process.kill()

        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(publish, range(threads)))
        expected = set(range(first, first + threads * each))
        eventually(lambda: expected <= set(stays.numbers), "all numbers")
        got = [number for number in stays.numbers if number >= first]
    assert len(got) == len(expected)
    for thread in range(threads):
        begin = first + thread * each
        assert is_gapless([number for number in got if begin <= number < begin + each])


def test_the_qos_of_subscriptions_is_read_from_the_graph() -> None:
    with world() as made:
        node = made.node()
        for durability in (DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL):
            for reliability in (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT):
                qos = QoSProfile(depth=DEPTH, durability=durability, reliability=reliability)
                node.create_subscription(Int64, "/numbers", print, qos)
        found = subscriptions_of(node.handle, "/numbers")
    listed = [(end.is_volatile, end.is_reliable) for end in sorted(found, key=lambda end: end.gid)]
    assert listed == [(True, True), (True, False), (False, True), (False, False)]


@pytest.mark.parametrize("during", ["socket_folder", "subscriptions_of", "DdsReader"])
def test_a_node_may_be_destroyed_while_its_subscription_is_added(
    during: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By another thread, before or between the steps that open the subscription's socket."""
    with world() as made:
        node = Node("short", context=made.context)
        for topic in ("/numbers", "/more"):
            node.create_subscription(Int64, topic, print, DEPTH)
        step = getattr(local_receiver, during)

        def destroy_first(*args: Any) -> Any:
            node.destroy_node()
            return step(*args)

        monkeypatch.setattr(local_receiver, during, destroy_first)
        made.executor.add_node(node)  # adds its entities at once, because nothing is spinning
        made.executor.spin_once(timeout_sec=0)


def test_a_reader_keeps_its_subscription_until_it_is_closed() -> None:
    with world() as made:
        node = Node("reader", context=made.context)
        subscription = node.create_subscription(Int64, "/numbers", print, DEPTH)
        reader = DdsReader(subscription.handle)
        node.destroy_subscription(subscription)
        assert reader.take() is None
        reader.close()
        assert reader.take() is None
        with pytest.raises(InvalidHandle):
            DdsReader(subscription.handle)
        node.destroy_node()
