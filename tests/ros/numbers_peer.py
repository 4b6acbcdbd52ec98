"""A subscriber in its own process: `python numbers_peer.py TOPIC COUNT`.

It prints the numbers of COUNT messages in the order of arrival, as one JSON list, and exits.
"""

import json
import sys

import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Int64

DEPTH = 10_000
"""History depth of both ends, so that a busy machine drops nothing."""


def main(topic: str, count: int) -> None:
    """Receive the messages."""
    rclpy.init(args=[])
    node = rclpy.create_node("peer")
    numbers: list[int] = []
    node.create_subscription(Int64, topic, lambda message: numbers.append(message.data), DEPTH)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while len(numbers) < count:
        executor.spin_once()
    print(json.dumps(numbers))
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
