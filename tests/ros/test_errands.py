"""Calls and single messages of a stack that its launcher's node makes, hears and publishes."""

import os
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Header, String

from obk_cli.adapters.launcher_look import ask_launcher
from obk_cli.adapters.live_runs import live_folders
from obk_cli.adapters.ros_errands import LONGEST_MESSAGE
from obk_cli.launch.runs import runs_folder
from obk_cli.ros.environment import ros_environment

from .stack import DEADLINE_S, DUMMY, eventually, launched, obk

pytestmark = pytest.mark.ros

RUN = """
import sys
from obk_cli.cli.main import main
try:
    main(sys.argv[1:])
except SystemExit as end:
    print("rclpy" in sys.modules, end.code)
"""
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def writer(monkeypatch: pytest.MonkeyPatch) -> Iterator[Node]:
    """A node that is none of a stack's."""
    for name, value in ros_environment().variables.items():
        monkeypatch.setenv(name, value)
    rclpy.init()
    node = Node("writer")
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


def run(*words: object, timeout_s: float = DEADLINE_S) -> tuple[str, str]:
    """What a command prints, and after it whether it has loaded ROS, with its exit code."""
    command = [sys.executable, "-c", RUN, *map(str, words), "--timeout", str(timeout_s)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=2 * DEADLINE_S)
    text, _, last = done.stdout.rstrip("\n").rpartition("\n")
    return f"{text}\n{done.stderr}", last


def counts(*words: str) -> bool:
    """Whether a short count is there; a busy machine may keep nodes silent for a second."""
    return run("topic", *words, "--duration", "1")[1] == "False 0"


def is_called() -> bool:
    """Whether a service answers; the first answer to a client may get lost."""
    state, end = run("service", "call", "obelisk_robot_0/get_state", timeout_s=10.0)
    return (end, 'label: "active"' in state) == ("False 0", True)


def test_a_stacks_launcher_calls_and_hears_for_others(writer: Any) -> None:
    with launched(DUMMY, "--quiet"):
        eventually(is_called, "an answer by the launcher")
        wrong, end = run("service", "call", "obelisk_robot_0/get_state", "{a: 1}")
        assert (end, "it has no fields" in wrong) == ("False 2", True), wrong
        nowhere, end = run("service", "call", "obelisk_robot_0/get_sate")
        assert (end, "did you mean" in nowhere) == ("False 1", True), nowhere
        number, end = run("topic", "echo", "ctrl", "u_mujoco[0]", "--once")
        assert (end, -2.0 < float(number) < 2.0) == ("False 0", True), number
        rows, end = run("topic", "echo", "ctrl", "--once", "--csv")
        assert (end, rows.count("\n")) == ("False 0", 2), rows
        wrong, end = run("topic", "echo", "ctrl", "u_mujco", "--once")
        assert (end, "did you mean `u_mujoco`" in wrong) == ("False 1", True), wrong
        eventually(lambda: counts("hz", "est", "ctrl"), "rates by the launcher")
        eventually(lambda: counts("delay", "imu"), "delays by the launcher")

        # What is long would hold up the launcher.
        long = "x" * (LONGEST_MESSAGE + 1)
        publisher = writer.create_publisher(String, "story", LATCHED)
        publisher.publish(String(data=long))
        story, end = run("topic", "echo", "/story", "data", "--once", "--format", "json")
        assert (end, len(story) > len(long)) == ("True 0", True), story[:200]


def test_a_stacks_launcher_publishes_for_others_where_no_robot_listens(writer: Any) -> None:
    heard: list[Header] = []
    listener = writer.create_subscription(Header, "/story", heard.append, LATCHED)

    def hears(frames: list[str]) -> bool:
        rclpy.spin_once(writer, timeout_sec=0.02)
        return [one.frame_id for one in heard] == frames

    def has_publisher() -> bool:
        return bool(writer.get_publishers_info_by_topic("/story"))

    with launched(DUMMY, "--quiet") as stack:
        text = "{stamp: now, frame_id: a}"
        said, end = run("topic", "pub", "/story", "std_msgs/msg/Header", text, "--once")
        assert (said, end) == ("published 1 message on /story\n", "False 0")
        eventually(lambda: hears(["a"]), "the message")
        assert heard[0].stamp.sec > 1_600_000_000
        eventually(lambda: not has_publisher(), "the end of the launcher's publisher")

        said, end = run("topic", "pub", "story", "{frame_id: b}", "-n", "1")
        assert (said, end) == ("published 1 message on /story\n", "False 0")
        wrong, end = run("topic", "pub", "story", "{frame: c}", "--once")
        assert (end, "frame: std_msgs/msg/Header has no such field" in wrong) == ("False 2", True)
        wrong, end = run("topic", "pub", "/story", "std_msgs/msg/String", "{}", "--once")
        assert (end, "/story is of the type std_msgs/msg/Header" in wrong) == ("False 1", True)
        wrong, end = run("topic", "pub", "ctrl", "{u_mujoco: [0.0]}", "--once")
        assert (end, "moves `/obelisk_robot_0`" in wrong) == ("False 1", True), wrong
        # Whom the user lets move the robot is known by a node of its own.
        words = ("{u_mujoco: [0.0]}", "--once", "--allow-foreign")
        said, end = run("topic", "pub", "ctrl", *words)
        assert (said, end) == ("published 1 message on /obelisk/dummy/ctrl\n", "True 0")

        # The launcher looks for itself, whoever asks it.
        (launcher,) = (ask_launcher([folder]) for folder in live_folders(runs_folder(os.environ)))
        assert launcher is not None
        kind = "obelisk_control_msgs/msg/PositionSetpoint"
        assert launcher.publish("/obelisk/dummy/ctrl", kind, {}, 1) is None
        assert launcher.publish("/story", "std_msgs/msg/Header", {}, 2) is None
        assert stack.process.poll() is None, stack.text
    eventually(lambda: hears(["a", "b"]), "two messages")
    writer.destroy_subscription(listener)


def test_who_is_let_publish_in_the_first_seconds_of_a_launch_does_not_end_it() -> None:
    with launched(DUMMY, "--quiet") as stack:
        words = ("topic", "pub", "ctrl", "{u_mujoco: [0.0]}", "-n", "30", "--rate", "10")
        done = obk(*words, "--allow-foreign", "--timeout", str(DEADLINE_S))
        assert done.stdout == "published 30 messages on /obelisk/dummy/ctrl\n", done.stderr
        assert stack.process.poll() is None, stack.text
        assert obk("lifecycle", "get", "control_0").stdout.split()[1:] == ["active"]
