"""A process that subscribes to what the benchmark of the simulator publishes.

`python -m benchmarks.subscriber PREFIX [--of-run]` runs until its standard input is closed. By
default it is a foreign node that never takes the messages it gets through DDS; with `--of-run` it
is a node as `obk launch` runs it, and takes all messages.
"""

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import rclpy
from obelisk_sensor_msgs.msg import ObkFramePose, ObkImu, ObkJointEncoders
from rclpy.node import Node

from obelisk_py.core.executor import EventLoopExecutor
from obelisk_py.core.lifecycle import GuardedLifecycleNode

__all__ = ["SOCKETS_VARIABLE", "node_of_run", "subscriber"]

ROOT: Final = Path(__file__).resolve().parents[1]
SOCKETS_VARIABLE: Final = "OBK_LOCAL_TRANSPORT"
"""Environment variable with the folder of a run's sockets, for the library's local transport."""
OF_RUN: Final = "--of-run"
TOPICS: Final = (
    (ObkJointEncoders, "/encoders"),
    (ObkJointEncoders, "/obelisk/dummy/obk_joint_encoders"),
    (ObkImu, "/obelisk/dummy/imu"),
    (ObkFramePose, "/obelisk/dummy/framepose"),
)


@contextmanager
def subscriber(prefix: str, *, is_of_run: bool = False) -> Iterator[None]:
    """Run a process that subscribes below a prefix; it may still be starting when entered."""
    options = [OF_RUN] if is_of_run else []
    command = [sys.executable, "-m", "benchmarks.subscriber", prefix, *options]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, cwd=ROOT)
    try:
        yield
    finally:
        process.communicate()


def node_of_run(prefix: str) -> GuardedLifecycleNode:
    """A node of the library that subscribes below a prefix."""
    node = GuardedLifecycleNode("subscriber")
    subscribe(node, prefix)
    return node


def subscribe(node: Node, prefix: str) -> None:
    """Subscribe to the three sensor groups and the encoders of 30 joints."""

    def drop(_message: Any) -> None: ...

    for message, topic in TOPICS:
        node.create_subscription(message, prefix + topic, drop, 10)


def main() -> None:
    """Subscribe until the standard input is closed."""
    rclpy.init()
    prefix, *options = sys.argv[1:]
    if OF_RUN not in options:
        # No thread takes the messages, because the benchmark measures the publisher.
        node = rclpy.create_node("subscriber")
        subscribe(node, prefix)
        sys.stdin.read()
        return
    executor = EventLoopExecutor()
    executor.add_node(node_of_run(prefix))
    threading.Thread(target=executor.spin, daemon=True).start()
    sys.stdin.read()
    executor.shutdown()


if __name__ == "__main__":
    main()
