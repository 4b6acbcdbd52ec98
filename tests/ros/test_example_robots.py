"""The example quadruped and arm, launched for real: their topics and their motion."""

import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import ObkForceSensor, ObkImage, ObkImu, ObkJointEncoders, ObkScan
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile

from .stack import eventually, launched

pytestmark = [pytest.mark.ros, pytest.mark.mujoco]

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@contextmanager
def receiving(
    topics: dict[str, type[Any]],
) -> Iterator[tuple[dict[str, list[Any]], Callable[..., None]]]:
    """The messages on topics, and a function that waits for them."""
    rclpy.init()
    node = rclpy.create_node("listener")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    received: dict[str, list[Any]] = {topic: [] for topic in topics}
    for topic, kind in topics.items():
        node.create_subscription(kind, topic, received[topic].append, QoSProfile(depth=1000))

    def wait(is_enough: Callable[[], object], what: str) -> None:
        eventually(lambda: is_enough() or executor.spin_once(timeout_sec=0.1), what)

    try:
        yield received, wait
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


def period_s(messages: list[Any]) -> float:
    """The shortest time between two messages, because a busy machine may lose some."""
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in messages]
    return min(b - a for a, b in itertools.pairwise(stamps))


@pytest.mark.slow  # the closed-loop tests of the example stand it up in lockstep
def test_the_quadruped_stands_up() -> None:
    topics = {
        "/quadruped/encoders": ObkJointEncoders,
        "/quadruped/imu": ObkImu,
        "/quadruped/feet": ObkForceSensor,
        "/quadruped/heights": ObkScan,
        "/quadruped/est": EstimatedState,
    }
    config = EXAMPLES / "quadruped" / "quadruped.yaml"
    with receiving(topics) as (received, wait), launched(config, "--quiet") as run:
        wait(lambda: all(len(messages) > 2 for messages in received.values()), "all topics")
        estimates = received["/quadruped/est"]
        wait(lambda: estimates[-1].q_base[2] > 0.25, "that it stands")
        assert len(received["/quadruped/heights"][0].data) == 17 * 11
        assert np.sum(received["/quadruped/feet"][-1].forces) > 50.0
        for name in ("encoders", "imu", "feet"):
            assert period_s(received[f"/quadruped/{name}"]) == pytest.approx(0.002)
        assert period_s(received["/quadruped/heights"]) == pytest.approx(0.1)
    assert run.process.returncode == 0, run.text


@pytest.mark.slow
def test_the_arm_reaches_its_first_pose_and_sees_the_table() -> None:
    topics = {
        "/arm/encoders": ObkJointEncoders,
        "/arm/wrist_force": ObkForceSensor,
        "/arm/wrist_camera": ObkImage,
        "/arm/est": EstimatedState,
    }
    above_the_red_box = [-0.11, 0.80, 1.19, 0.0, 1.14, 0.0]
    with (
        receiving(topics) as (received, wait),
        launched(EXAMPLES / "arm" / "arm.yaml", "--quiet") as run,
    ):
        wait(lambda: all(len(messages) > 2 for messages in received.values()), "all topics")
        estimates = received["/arm/est"]
        wait(lambda: np.allclose(estimates[-1].q_joints, above_the_red_box, atol=0.02), "the pose")
        assert np.abs(np.subtract(estimates[0].q_joints, above_the_red_box)).max() > 0.2
        picture = received["/arm/wrist_camera"][-1].y
        assert [dim.size for dim in picture.layout.dim] == [120, 160, 3]
        assert np.std(picture.data) > 5.0
        assert period_s(received["/arm/encoders"]) == pytest.approx(0.002)
        assert period_s(received["/arm/wrist_force"]) == pytest.approx(0.01)
    assert run.process.returncode == 0, run.text
