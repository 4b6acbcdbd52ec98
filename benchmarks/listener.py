"""A process that subscribes to what the benchmark of the simulator publishes, and takes nothing.

`python -m benchmarks.listener PREFIX` listens until its standard input ends.
"""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import rclpy
from obelisk_sensor_msgs.msg import ObkFramePose, ObkImu, ObkJointEncoders

__all__ = ["listener"]

ROOT: Final = Path(__file__).resolve().parents[1]
HEARD_S: Final = 3.0
"""Until it has found the publishers [s]."""
TOPICS: Final = (
    (ObkJointEncoders, "/encoders"),
    (ObkJointEncoders, "/obelisk/dummy/obk_joint_encoders"),
    (ObkImu, "/obelisk/dummy/imu"),
    (ObkFramePose, "/obelisk/dummy/framepose"),
)


@contextmanager
def listener(prefix: str) -> Iterator[None]:
    """While entered, such a process listens below a prefix."""
    process = subprocess.Popen(
        [sys.executable, "-m", "benchmarks.listener", prefix], stdin=subprocess.PIPE, cwd=ROOT
    )
    try:
        time.sleep(HEARD_S)
        yield
    finally:
        process.communicate()


def main() -> None:
    """Subscribe to the three groups and the encoders of 30 joints."""
    rclpy.init()
    node = rclpy.create_node("listener")
    for message, topic in TOPICS:
        # Nobody takes what comes: the writer's side is what is measured.
        node.create_subscription(message, sys.argv[1] + topic, print, 10)
    sys.stdin.read()


if __name__ == "__main__":
    main()
