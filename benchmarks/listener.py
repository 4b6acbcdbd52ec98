"""A process that subscribes to what the benchmark of the simulator publishes.

`python -m benchmarks.listener PREFIX [--of-run]` listens until its standard input ends: a foreign
node, which takes nothing of what comes through DDS, or with `--of-run` a node as `obk launch` runs
it, which takes everything.
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

__all__ = ["SOCKETS_VARIABLE", "listener", "node_of_run"]

ROOT: Final = Path(__file__).resolve().parents[1]
SOCKETS_VARIABLE: Final = "OBK_LOCAL_TRANSPORT"
"""Names the folder of a run's sockets, if the library has a local transport."""
OF_RUN: Final = "--of-run"
TOPICS: Final = (
    (ObkJointEncoders, "/encoders"),
    (ObkJointEncoders, "/obelisk/dummy/obk_joint_encoders"),
    (ObkImu, "/obelisk/dummy/imu"),
    (ObkFramePose, "/obelisk/dummy/framepose"),
)


@contextmanager
def listener(prefix: str, *, is_of_run: bool = False) -> Iterator[None]:
    """While entered, such a process listens below a prefix, as soon as it has started."""
    words = [sys.executable, "-m", "benchmarks.listener", prefix, *([OF_RUN] if is_of_run else [])]
    process = subprocess.Popen(words, stdin=subprocess.PIPE, cwd=ROOT)
    try:
        yield
    finally:
        process.communicate()


def node_of_run(prefix: str) -> GuardedLifecycleNode:
    """A node of the library that subscribes below a prefix."""
    node = GuardedLifecycleNode("listener")
    subscribe(node, prefix)
    return node


def subscribe(node: Node, prefix: str) -> None:
    """Subscribe to the three groups and the encoders of 30 joints."""

    def drop(_message: Any) -> None: ...

    for message, topic in TOPICS:
        node.create_subscription(message, prefix + topic, drop, 10)


def main() -> None:
    """Listen until the standard input ends."""
    rclpy.init()
    prefix, *options = sys.argv[1:]
    if OF_RUN not in options:
        # Nothing takes the messages: the writer's side is what is measured.
        node = rclpy.create_node("listener")
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
