"""A running stack that receives invalid messages, and one whose simulation diverges."""

import json
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import rclpy
from obelisk_control_msgs.msg import PositionSetpoint
from std_msgs.msg import String

from .stack import DUMMY, Launched, eventually, launched, obk

pytestmark = [pytest.mark.ros, pytest.mark.mujoco]

TOPIC = "/obelisk/dummy/ctrl"
HEADER = b"\0\1\0\0"
MALFORMED = (
    b"",
    b"\0",
    HEADER,
    b"\xff" * 64,
    HEADER + struct.pack("<iII", 0, 0, 2**32 - 1),
    HEADER + struct.pack("<iII", 0, 0, 5) + b"frame",
    HEADER + struct.pack("<iIIxI", 0, 0, 1, 2**31) + b"\0" * 8,
    b"\0\2\0\0" + b"\x7f" * 200,
)
"""Truncated messages, lengths beyond the end, another encoding."""


def states() -> dict[str, Any]:
    reported: dict[str, Any] = json.loads(obk("lifecycle", "get", "--format", "json").stdout)
    return reported


def is_refused(publisher: Any, run: Launched) -> bool:
    """Send another control of the wrong length; return whether it was rejected."""
    publisher.publish(PositionSetpoint(u_mujoco=[1.0, 2.0, 3.0]))
    return "`u_mujoco` has the length 3" in run.text


def test_invalid_bytes_end_neither_robot_nor_stack() -> None:
    with launched(DUMMY, "--allow-foreign") as run:
        rclpy.init()
        try:
            node = rclpy.create_node("foreign")
            publisher = node.create_publisher(PositionSetpoint, TOPIC, 10)
            other = node.create_publisher(String, f"{TOPIC}/other", 10)
            eventually(publisher.get_subscription_count, "the robot's subscription")
            for data in MALFORMED * 3:
                publisher.publish(data)
                other.publish(data)
            run.wait_for_line("dropped a message on")
            eventually(lambda: is_refused(publisher, run), "the refusal of a wrong length")
            node.destroy_node()
        finally:
            rclpy.try_shutdown()
        eventually(lambda: set(states().values()) == {"active"}, "three active nodes")
    assert "Traceback" not in run.text
    assert "stopped cleanly" in run.lines


FOREIGN = """
import rclpy
from obelisk_sensor_msgs.msg import JointEncoders
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("foreign")
weak = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
text = node.create_publisher(String, "/obelisk/dummy/ctrl", 10)
sensor = node.create_publisher(JointEncoders, "/obelisk/dummy/joint_encoders", weak)

def send():
    text.publish(String(data="go"))
    sensor.publish(JointEncoders(y=[9.0]))

node.create_timer(0.05, send)
rclpy.spin(node)
"""


def test_a_publisher_outside_is_accepted_on_an_external_topic(tmp_path: Path) -> None:
    """Next to the stack's own controller, before and after the launch."""
    shutil.copytree(DUMMY.parent, tmp_path, dirs_exist_ok=True)
    config = tmp_path / DUMMY.name
    config.write_text(f"{DUMMY.read_text()}\nexternal_topics: [{TOPIC}]\n")
    rclpy.init()
    try:
        node = rclpy.create_node("teleop")
        publisher = node.create_publisher(PositionSetpoint, TOPIC, 10)
        with launched(config) as run:
            eventually(publisher.get_subscription_count, "the robot's subscription")
            eventually(lambda: is_refused(publisher, run), "its commands at the robot")
            late = node.create_publisher(PositionSetpoint, TOPIC, 10)
            eventually(late.get_subscription_count, "the robot's subscription")
            eventually(lambda: set(states().values()) == {"active"}, "three active nodes")
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    assert "--allow-foreign" not in run.text
    assert "stopped cleanly" in run.lines


def test_ends_that_do_not_fit_are_reported_and_no_callback_gets_their_messages() -> None:
    with launched(DUMMY, "--allow-foreign") as run:
        foreign = subprocess.Popen([sys.executable, "-c", FOREIGN])
        try:
            reported = (
                "/obelisk/dummy/ctrl has the type obelisk_control_msgs/msg/PositionSetpoint in "
                "this stack and std_msgs/msg/String in /foreign: these nodes do not receive each "
                "other's messages"
            )
            run.wait_for_line(reported)
            view = json.loads(obk("monitor", "--once", "--format", "json").stdout)
            assert f"warning: {reported}" in view["lines"]
            run.wait_for_line(
                "New publisher discovered on topic '/obelisk/dummy/joint_encoders', offering "
                "incompatible QoS"
            )
        finally:
            foreign.kill()
            foreign.wait()
        eventually(lambda: set(states().values()) == {"active"}, "three active nodes")
    assert "Traceback" not in run.text
    assert "dropped a message" not in run.text
    assert "stopped cleanly" in run.lines


def test_a_simulation_that_diverges_ends_the_stack_with_time_joint_and_body(
    tmp_path: Path,
) -> None:
    model = DUMMY.with_name("dummy.xml").read_text()
    stiff = model.replace('name="joint1"', 'name="joint1" stiffness="1e9"')
    (tmp_path / "dummy.xml").write_text(stiff.replace('timestep="0.001"', 'timestep="0.01"'))
    (tmp_path / "dummy_params.txt").write_bytes(DUMMY.with_name("dummy_params.txt").read_bytes())
    (tmp_path / "dummy.yaml").write_bytes(DUMMY.read_bytes())
    result = obk("launch", tmp_path / "dummy.yaml", "--duration", "30")
    assert result.returncode == 1, result.stdout
    failed = next(line for line in result.stdout.splitlines() if line.startswith("failed: "))
    assert "diverged at 0." in failed
    assert "`joint1` of body `link1`" in failed
