"""The library packs and unpacks messages like rclpy, or raises an error."""

import struct
from collections.abc import Iterator
from typing import Any

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from obelisk_py.core.exceptions import ObeliskMsgError
from obelisk_py.core.lifecycle import GuardedLifecycleNode
from obelisk_py.core.serialization.codec import codec_for

from .executor_world import World, eventually, world

pytestmark = pytest.mark.ros

DEPTH = 10
HEAD = b"\0\1\0\0"


@pytest.fixture
def one() -> Iterator[World]:
    with world() as made:
        yield made


def test_invalid_bytes_are_reported_and_reach_no_callback(
    one: World, capfd: pytest.CaptureFixture[str]
) -> None:
    node = one.node()
    received: list[str] = []
    node.create_subscription(String, "topic", lambda message: received.append(message.data), DEPTH)
    publisher = node.create_publisher(String, "topic", DEPTH)
    publisher.publish(HEAD + struct.pack("<I", 100) + b"too short\0")
    publisher.publish(String(data="good"))
    one.run_until(lambda: received, "the message behind the wrong one")
    assert received == ["good"]
    reported = capfd.readouterr().err
    assert all(part in reported for part in ("`/topic`", "18 bytes", "std_msgs/msg/String"))


def test_drops_are_reported_now_and_then_of_each_topic_for_itself(
    one: World, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("obelisk_py.core.executor.handlers._DROP_LOG_PERIOD_S", 3600.0)
    node = one.node()
    received: list[str] = []
    for topic in ("left", "right"):
        node.create_subscription(String, topic, lambda m: received.append(m.data), DEPTH)
        publisher = node.create_publisher(String, topic, DEPTH)
        for _ in range(3):
            publisher.publish(HEAD + struct.pack("<I", 100) + b"too short\0")
        publisher.publish(String(data="good"))
    one.run_until(lambda: len(received) == 2, "the messages behind the wrong ones")
    reported = capfd.readouterr().err
    assert reported.count("dropped a message on `/left`") == 1
    assert reported.count("dropped a message on `/right`") == 1


def test_big_endian_bytes_are_read_as_well(one: World) -> None:
    node = one.node()
    received: list[str] = []
    node.create_subscription(String, "topic", lambda message: received.append(message.data), DEPTH)
    big_endian = b"\0\0\0\0" + struct.pack(">I", 6) + b"hello\0"
    node.create_publisher(String, "topic", DEPTH).publish(big_endian)
    one.run_until(lambda: received, "the message")
    assert received == ["hello"]


def test_a_callback_that_takes_infos_gets_a_message_and_its_info(one: World) -> None:
    node = one.node()
    received: list[tuple[Any, Any]] = []

    def receive(message: JointState, info: Any) -> None:
        received.append((message, info))

    node.create_subscription(JointState, "topic", receive, DEPTH)
    sent = JointState(name=["hip"], position=[1.5])
    node.create_publisher(JointState, "topic", DEPTH).publish(sent)
    one.run_until(lambda: received, "the message")
    assert received[0][0] == sent
    assert received[0][1]["source_timestamp"] > 0


def enabled_publisher(node: GuardedLifecycleNode, message_class: Any) -> Any:
    publisher = node.create_lifecycle_publisher(message_class, "topic", DEPTH)
    publisher.on_activate(None)
    return publisher


def test_values_that_a_field_cannot_hold_are_rejected_and_nothing_is_sent(one: World) -> None:
    node = one.adopt(GuardedLifecycleNode("node", context=one.context))
    received: list[str] = []
    raw: list[bytes] = []
    node.create_subscription(String, "topic", lambda message: received.append(message.data), DEPTH)
    node.create_subscription(String, "topic", raw.append, DEPTH, raw=True)
    publisher = enabled_publisher(node, String)
    wrong: Any = 3
    with one.spinning():
        with pytest.raises(ObeliskMsgError, match="`data` of std_msgs/msg/String"):
            publisher.publish(String(data=wrong))
        publisher.publish(String(data="good"))
        eventually(lambda: received and raw, "the message behind the wrong one")
    assert received == ["good"]
    assert raw == [HEAD + struct.pack("<I", 5) + b"good\0"]


def test_bytes_passed_within_the_process_are_checked_too(one: World) -> None:
    node = one.adopt(GuardedLifecycleNode("node", context=one.context))
    received: list[str] = []
    node.create_subscription(String, "topic", lambda message: received.append(message.data), DEPTH)
    publisher = enabled_publisher(node, String)
    with one.spinning():
        publisher.publish(HEAD + struct.pack("<I", 100) + b"too short\0")
        publisher.publish(String(data="good"))
        eventually(lambda: received, "the message behind the wrong one")
    assert received == ["good"]


def test_a_message_of_another_class_is_rejected(one: World) -> None:
    node = one.adopt(GuardedLifecycleNode("node", context=one.context))
    with pytest.raises(TypeError, match="JointState"):
        enabled_publisher(node, String).publish(JointState())


def test_a_destroyed_publisher_publishes_nothing_and_reports_it(one: World) -> None:
    node = one.adopt(GuardedLifecycleNode("node", context=one.context))
    publisher = enabled_publisher(node, String)
    node.destroy_publisher(publisher)
    with pytest.raises(Exception, match="destruction was requested"):
        publisher.publish(String())


def test_rclpys_own_executor_reads_messages_packed_by_the_library() -> None:
    with world() as made:
        node = made.adopt(GuardedLifecycleNode("node", context=made.context))
        publisher = enabled_publisher(node, JointState)
        listener = Node("listener", context=made.context)
        received: list[JointState] = []
        listener.create_subscription(JointState, "topic", received.append, DEPTH)
        executor = SingleThreadedExecutor(context=made.context)
        executor.add_node(listener)
        sent = JointState(name=["hip", "knee"], position=[1.5, -2.0])
        publisher.publish(sent)
        publisher.publish(codec_for(JointState).pack(sent))

        def are_received() -> bool:
            executor.spin_once(timeout_sec=0.1)
            return len(received) == 2

        eventually(are_received, "both messages")
        executor.shutdown()
        listener.destroy_node()
    assert received == [sent, sent]
