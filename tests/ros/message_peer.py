"""One end of a message exchange; run as `message_peer.py send|receive package/Message ...`.

The sender publishes one filled message per type until its standard input is closed. The receiver
prints the received messages as JSON, type by type, and exits when it has all or after a deadline.
"""

import importlib
import itertools
import json
import re
import sys
import time
from collections.abc import Iterator
from typing import Any

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

DEADLINE_S = 60.0
QOS = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)


def message_type(name: str) -> type[Any]:
    """Return the class of `package/Message`."""
    package, _, message = name.partition("/")
    return getattr(importlib.import_module(f"{package}.msg"), message)


def filled(name: str, numbers: Iterator[int] | None = None) -> Any:
    """Return a message in which every field has a different value."""
    numbers = numbers or itertools.count(1)
    message = message_type(name)()
    for field, kind in message.get_fields_and_field_types().items():
        setattr(message, field, _value(kind, numbers))
    return message


def _value(kind: str, numbers: Iterator[int]) -> Any:
    if sequence := re.fullmatch(r"sequence<(.+)>", kind):
        return [_value(sequence[1], numbers) for _ in range(3)]
    if array := re.fullmatch(r"(.+)\[(\d+)\]", kind):
        return [_value(array[1], numbers) for _ in range(int(array[2]))]
    if "/" in kind:
        return filled(kind, numbers)
    number = next(numbers)
    if kind in ("float", "double"):
        return number + 0.5
    return f"text {number}" if kind == "string" else number


def plain(value: Any) -> Any:
    """Convert a message to dictionaries, lists, numbers and strings."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, str | int | float):
        return value
    return [plain(item) for item in value.tolist()] if hasattr(value, "tolist") else _each(value)


def _each(values: Any) -> list[Any]:
    return [plain(value) for value in values]


def topic_of(name: str) -> str:
    """Return the topic for a type."""
    return "/exchange/" + name


def send(names: list[str]) -> None:
    """Publish until standard input is closed."""
    node = rclpy.create_node("sender")
    for name in names:
        node.create_publisher(message_type(name), topic_of(name), QOS).publish(filled(name))
    sys.stdin.read()
    node.destroy_node()


def receive(names: list[str]) -> None:
    """Collect one message of each type and print them."""
    node = rclpy.create_node("receiver")
    received: dict[str, Any] = {}
    for name in names:
        node.create_subscription(
            message_type(name),
            topic_of(name),
            lambda message, name=name: received.setdefault(name, plain(message)),
            QOS,
        )
    deadline = time.monotonic() + DEADLINE_S
    while len(received) < len(names) and time.monotonic() < deadline:
        rclpy.spin_once(node, timeout_sec=0.1)
    json.dump(received, sys.stdout)
    node.destroy_node()


if __name__ == "__main__":
    rclpy.init()
    {"send": send, "receive": receive}[sys.argv[1]](sys.argv[2:])
    rclpy.shutdown()
