"""Run the dummy stack for a while, observe it from outside, and print a summary.

Usage: `python examples/dummy/demo.py [SECONDS]`; `make demo` runs it for 20 s. The observer is an
ordinary ROS 2 node that knows only the names of the topics.
"""

import os
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import JointEncoders
from rclpy.node import Node
from rclpy.serialization import deserialize_message

import obelisk_py  # noqa: F401  (adds the older field names `u` and `x_hat` to the messages)
from obelisk_py.core.executor import EventLoopExecutor
from obk_cli.ros.environment import ros_environment

TOPICS = {
    "/obelisk/dummy/ctrl": PositionSetpoint,
    "/obelisk/dummy/est": EstimatedState,
    "/obelisk/dummy/joint_encoders": JointEncoders,
}
SETTLING_S = 2.0
"""Time to ignore at the start, because the joint starts away from the command [s]."""
SPARK = "▁▂▃▄▅▆▇█"


@dataclass
class Watched:
    """The messages received on one topic."""

    times: list[float] = field(default_factory=list)
    """Arrival time of each message [s]."""
    samples: list[tuple[float, float]] = field(default_factory=list)
    """(time [s], first value) of every tenth message."""

    @property
    def rate_hz(self) -> float:
        """Messages per second, from the first to the last message."""
        span = self.times[-1] - self.times[0] if len(self.times) > 1 else 0.0
        return (len(self.times) - 1) / span if span else 0.0


class Watcher(Node):  # type: ignore[misc]
    """Counts the messages on the topics of the dummy stack."""

    def __init__(self) -> None:
        """Subscribe to raw messages, which is cheap."""
        super().__init__("dummy_watcher")
        self.watched = {topic: Watched() for topic in TOPICS}
        for topic, kind in TOPICS.items():
            self.create_subscription(kind, topic, self._callback(topic, kind), 100, raw=True)

    def _callback(self, topic: str, kind: type[Any]) -> Any:
        watched = self.watched[topic]

        def take(data: bytes) -> None:
            now = time.monotonic()
            if len(watched.times) % 10 == 0:
                values = first_values(deserialize_message(data, kind))
                watched.samples.extend((now, float(value)) for value in values[:1])
            watched.times.append(now)

        return take


def first_values(message: Any) -> Any:
    """The values of a message: the command, the estimate or the measurement."""
    if isinstance(message, PositionSetpoint):
        return message.u
    return message.x_hat if isinstance(message, EstimatedState) else message.y


def correlation(command: Watched, joint: Watched) -> float | None:
    """Pearson correlation of joint position and command, after the joint has settled."""
    times, values = np.array(joint.samples).T
    is_settled = times > times[0] + SETTLING_S
    if np.count_nonzero(is_settled) < 2:
        return None
    commands = np.interp(times[is_settled], *np.array(command.samples).T)
    return float(np.corrcoef(commands, values[is_settled])[0, 1])


def sparkline(watched: Watched, columns: int = 64) -> str:
    """Draw the values over time as a line of blocks."""
    values = np.array([value for _, value in watched.samples])
    chosen = values[np.linspace(0, len(values) - 1, columns).astype(int)]
    span = float(np.ptp(chosen)) or 1.0
    levels = ((chosen - chosen.min()) / span * (len(SPARK) - 1)).round().astype(int)
    return "".join(SPARK[level] for level in levels)


def launch(seconds: float) -> int:
    """Run the stack until it ends; return the exit code of `obk launch`."""
    config = Path(__file__).with_name("dummy.yaml")
    obk = Path(sys.executable).with_name("obk")
    with subprocess.Popen([obk, "launch", config, "--duration", f"{seconds:g}"]) as stack:
        try:
            return stack.wait()
        except KeyboardInterrupt:
            # Ctrl-C goes to the whole terminal, so the stack is already shutting down.
            return stack.wait()


def watch(seconds: float) -> tuple[int, dict[str, Watched]]:
    """Launch the stack and observe it until it ends."""
    rclpy.init()
    watcher = Watcher()
    executor = EventLoopExecutor()
    executor.add_node(watcher)
    spinning = threading.Thread(target=executor.spin, daemon=True)
    spinning.start()
    try:
        return launch(seconds), watcher.watched
    finally:
        executor.shutdown()
        spinning.join()
        watcher.destroy_node()
        rclpy.try_shutdown()


def main() -> int:
    """Launch the stack, observe it and print the summary."""
    os.environ.update(ros_environment().variables)  # use the same ROS settings as the stack
    code, watched = watch(float(sys.argv[1]) if len(sys.argv) > 1 else 20.0)
    command, joint = (
        watched[topic] for topic in ("/obelisk/dummy/ctrl", "/obelisk/dummy/joint_encoders")
    )
    print("\nWhat happened")
    for topic, seen in watched.items():
        print(f"  {topic:<30} {len(seen.times):>6} messages  {seen.rate_hz:7.1f} Hz")
    if code != 0 or not command.samples or not joint.samples:
        print("  the stack did not run correctly")
        return code or 1
    print(f"  command  {sparkline(command)}")
    print(f"  joint1   {sparkline(joint)}")
    followed, since = correlation(command, joint), f"after the first {SETTLING_S:g} s"
    if followed is None:
        print(f"  too short to check whether joint1 follows: the check uses data {since}")
    else:
        print(f"  joint1 followed the command sin(t): correlation {followed:.4f} {since}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
