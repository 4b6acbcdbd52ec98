"""`obk topic hz` on publishers of this process, even of a type that is not built here."""

import json
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count, pairwise
from typing import Any

import pytest
import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from std_msgs.msg import Int32

from obk_cli.errors import CommandFailedError
from obk_cli.ros.types import opaque_type

from .looking import announce_as_a_stack_does, error_of
from .stack import DEADLINE_S, OBK, eventually, obk

pytestmark = pytest.mark.ros


@pytest.fixture(autouse=True)
def _found_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    announce_as_a_stack_does(monkeypatch)


@contextmanager
def measuring(topic: str) -> Iterator["subprocess.Popen[str]"]:
    """Run `obk topic hz` until the test has enough output."""
    process = subprocess.Popen(
        [OBK, "topic", "hz", topic, "--format", "json", "--timeout", "60"],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.send_signal(2)
        process.wait(DEADLINE_S)
        assert process.stdout is not None
        process.stdout.close()


def measured(node: Node, topic: str) -> tuple[Any, float]:
    """Publish 1000 messages at 1 kHz, or as fast as this machine can; return the rate."""
    publisher = node.create_publisher(Int32, topic, 1000)
    with measuring(topic) as process:
        eventually(publisher.get_subscription_count, "a subscription")
        clock, begin = node.get_clock(), node.get_clock().now().nanoseconds
        for number in range(1000):
            while clock.now().nanoseconds < begin + number * 1_000_000:
                pass
            publisher.publish(Int32(data=number))
        own_s = (clock.now().nanoseconds - begin) * 1e-9
        assert process.stdout is not None
        rates = (json.loads(line) for line in process.stdout)
        rate = next(later for rate, later in pairwise(rates) if later["count"] == rate["count"])
    node.destroy_publisher(publisher)
    return rate, 999 / own_s


def test_a_measured_rate_is_that_of_the_publisher() -> None:
    rclpy.init()
    try:
        node = rclpy.create_node("quick")

        def is_own() -> bool:
            """Repeat once, because a busy machine may receive the first or the last message late.

            The first ones are missed if the subscription finds the publisher after it was found.
            """
            rate, own_hz = measured(node, f"/quick{next(numbers)}")
            if rate["count"] + rate["lost"] < 1000:
                return False
            assert rate["lost"] == 0
            assert rate["seen"] == 1000
            assert rate["min_s"] <= 1 / rate["rate_hz"] <= rate["max_s"]
            assert rate["mean_bytes"] == len(serialize_message(Int32()))
            return bool(rate["rate_hz"] == pytest.approx(own_hz, rel=0.1))

        numbers = count()
        eventually(is_own, "the rate of the publisher")
        node.destroy_node()
    finally:
        rclpy.try_shutdown()


def test_a_type_that_is_not_built_here_is_counted_and_cannot_be_shown() -> None:
    rclpy.init()
    try:
        node = rclpy.create_node("foreign")
        kind = opaque_type("nowhere_msgs/msg/Odd", "")
        qos: Any = QoSProfile(depth=10)
        with node.handle:
            publisher = rclpy_implementation.Publisher(
                node.handle, kind, "/odd", qos.get_c_qos_profile()
            )
        data = serialize_message(Int32(data=7))
        is_over = threading.Event()

        def talk() -> None:
            while not is_over.wait(0.01):
                publisher.publish_raw(data)

        thread = threading.Thread(target=talk)
        thread.start()
        try:
            rate: dict[str, Any] = {}

            def is_measured() -> bool:
                result = obk("topic", "hz", "/odd", "--duration", "1", "--format", "json")
                rate.update(json.loads(result.stdout))
                return result.returncode == 0

            eventually(is_measured, "messages")
            complaint = error_of("topic", "echo", "/odd", "--once")
        finally:
            is_over.set()
            thread.join()
        publisher.destroy_when_not_in_use()
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    assert rate["count"] > 0
    assert rate["mean_bytes"] == len(data)
    assert "nowhere_msgs/msg/Odd" in complaint
    assert "`obk build nowhere_msgs`" in complaint


def test_types_of_other_dds_programs_and_of_an_older_ros_are_no_fault() -> None:
    assert opaque_type("nowhere_msgs/msg/Older", "INVALID").__name__ == "Older"
    with pytest.raises(CommandFailedError, match="`Odd`"):
        opaque_type("Odd", "")
