"""A subscription or publisher of a run, in its own process.

`python local_peer.py listen TOPIC DEPTH FILE` writes the received numbers to FILE, one per line;
`python local_peer.py publish TOPIC FIRST PERIOD_S` publishes FIRST, FIRST + 1, ... until it is
killed.
"""

import sys
from pathlib import Path

import rclpy
from std_msgs.msg import Int64

from obelisk_py.core.executor import EventLoopExecutor
from obelisk_py.core.lifecycle import GuardedLifecycleNode


def listen(topic: str, depth: str, path: str) -> None:
    """Receive until killed."""
    node = GuardedLifecycleNode("listener")
    with Path(path).open("w", buffering=1, encoding="ascii") as numbers:
        node.create_subscription(
            Int64, topic, lambda message: numbers.write(f"{message.data}\n"), int(depth)
        )
        spin(node)


def publish(topic: str, first: str, period_s: str) -> None:
    """Publish until killed."""
    node = GuardedLifecycleNode("publisher")
    publisher = node.create_lifecycle_publisher(Int64, topic, 100)
    publisher.on_activate(None)
    count = int(first)

    def tick() -> None:
        nonlocal count
        publisher.publish(Int64(data=count))
        count += 1

    node.create_timer(float(period_s), tick)
    spin(node)


def spin(node: GuardedLifecycleNode) -> None:
    executor = EventLoopExecutor()
    executor.add_node(node)
    executor.spin()


if __name__ == "__main__":
    rclpy.init(args=[])
    {"listen": listen, "publish": publish}[sys.argv[1]](*sys.argv[2:])
