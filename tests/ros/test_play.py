"""`obk play`: publish recordings in real time, or replay them into nodes in lockstep."""

import re
import struct
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import rclpy
from obelisk_control_msgs.msg import PositionSetpoint
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64, Int32

from obelisk_recordings.run import open_run
from obk_cli.record.mcap_writer import BagWriter
from obk_cli.record.recorder import installed_definition, schema_text

from .stack import DEADLINE_S, EXAMPLE, OBK, eventually, obk

pytestmark = pytest.mark.ros

COUNT = 200
STEP_NS = 5_000_000
BEGIN_NS = 1_700_000_000_000_000_000
TESTS = """
def test_it_runs(stack):
    stack("{config}").run(1.0)
"""


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A recording of numbers on two topics, 1 s long, and one command."""
    path = tmp_path / "numbers.mcap"
    kinds = {"/count": "std_msgs/msg/Int32", "/value": "std_msgs/msg/Float64"}
    with BagWriter(path) as writer:
        channels = [
            writer.add_topic(name, kind, schema_text(kind, installed_definition) or "", {})
            for name, kind in kinds.items()
        ]
        kind = "obelisk_control_msgs/msg/PositionSetpoint"
        text = schema_text(kind, installed_definition) or ""
        command = writer.add_topic("/ctrl", kind, text, {})
        for number in range(COUNT):
            time_ns = BEGIN_NS + number * STEP_NS
            data = (struct.pack("<i", number), struct.pack("<d", number / 2))
            for channel, one in zip(channels, data, strict=True):
                writer.add_message(channel, b"\0\1\0\0" + one, time_ns, time_ns, number)
        empty = b"\0\1\0\0" + bytes(8) + struct.pack("<I", 1) + bytes(4) + bytes(8)
        writer.add_message(command, empty, time_ns, time_ns, COUNT)
    return path


@contextmanager
def listening() -> Iterator[tuple[Node, dict[str, list[tuple[float, float]]]]]:
    """A node that collects numbers with their arrival times, and commands."""
    received: dict[str, list[tuple[float, float]]] = {"/count": [], "/value": [], "/ctrl": []}
    rclpy.init()
    try:
        node = rclpy.create_node("listener")
        for kind, name in ((Int32, "/count"), (Float64, "/value")):
            node.create_subscription(
                kind,
                name,
                lambda message, name=name: received[name].append((time.monotonic(), message.data)),
                QoSProfile(depth=2 * COUNT),
            )
        node.create_subscription(
            PositionSetpoint, "/ctrl", lambda _: received["/ctrl"].append((0.0, 0.0)), 10
        )
        yield node, received
    finally:
        rclpy.try_shutdown()


def played(node: Node, *words: object) -> subprocess.CompletedProcess[str]:
    """Run `obk play` while the node receives."""
    process = subprocess.Popen(
        [str(OBK), "play", *map(str, words), "--timeout", str(DEADLINE_S)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    with process:
        while process.poll() is None:
            rclpy.spin_once(node, timeout_sec=0.01)
        out, error = process.communicate()
    return subprocess.CompletedProcess(process.args, process.returncode, out, error)


def test_every_message_is_replayed_in_order_except_commands(recording: Path) -> None:
    with listening() as (node, received):
        done = played(node, recording, "--rate", "4")
        assert done.returncode == 0, done.stderr

        def all_came() -> bool:
            rclpy.spin_once(node, timeout_sec=0.01)
            return len(received["/count"]) == len(received["/value"]) == COUNT

        eventually(all_came, "all messages")
    assert [value for _, value in received["/count"]] == list(range(COUNT))
    assert [value for _, value in received["/value"]] == [number / 2 for number in range(COUNT)]
    # It cannot be faster than requested.
    assert received["/count"][-1][0] - received["/count"][0][0] > 0.5 * COUNT * STEP_NS * 1e-9 / 4
    assert received["/ctrl"] == []
    assert done.stderr.startswith("note: skipping /ctrl")
    assert "/count  200 messages" in done.stdout


def test_commands_are_published_only_on_purpose(recording: Path) -> None:
    refused = obk("play", recording, "--topic", "ctrl")
    assert refused.returncode == 1
    assert "`/ctrl`" in refused.stderr
    assert "--allow-hardware" in refused.stderr
    with listening() as (node, received):
        done = played(node, recording, "--topic", "ctrl", "--allow-hardware")
        assert done.returncode == 0, done.stderr
        eventually(
            lambda: rclpy.spin_once(node, timeout_sec=0.01) or received["/ctrl"], "the command"
        )
    assert received["/count"] == []


def test_live_topics_of_a_robots_stack_are_not_published(recording: Path) -> None:
    with listening() as (node, received):
        publisher = node.create_publisher(Int32, "/count", 10)
        robot = rclpy.create_node("obelisk_robot_0")
        done = played(node, recording, "--rate", "4")
        assert done.returncode == 1
        assert "/count is published by `/listener`" in done.stderr
        assert received["/count"] == received["/value"] == []
        done = played(node, recording, "--rate", "4", "--topic", "value")
        assert done.returncode == 0, done.stderr
        robot.destroy_node()
        publisher.destroy()


@pytest.mark.parametrize(
    ("words", "reported"),
    [
        (("--nodes", "estimation"), "need `--into CONFIG`"),
        (("--into", EXAMPLE), "`--into` needs `--nodes`"),
        (("--into", EXAMPLE, "--nodes", "estimtion"), "did you mean `estimation`"),
        (("--into", EXAMPLE, "--nodes", "estimation"), "no messages for the selected nodes"),
        (("--topic", "speed"), "no topic `speed`"),
        (("--rate", "0"), "`--rate 0`"),
        (("--real-time",), "needs `--into CONFIG`"),
        (("--into", EXAMPLE, "--nodes", "estimation", "--rate", "2"), "needs `--real-time`"),
        (("--into", EXAMPLE, "--nodes", "estimation", "--tolerance", "1"), "needs `--real-time`"),
    ],
)
def test_a_mistake_is_reported(recording: Path, words: tuple[object, ...], reported: str) -> None:
    done = obk("play", recording, *words)
    assert done.returncode != 0
    assert reported in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("mode", [(), ("--real-time",)])
def test_the_output_replaces_no_recording_and_no_other_file(
    recording: Path, tmp_path: Path, mode: tuple[str, ...]
) -> None:
    before, notes = recording.read_bytes(), tmp_path / "notes.txt"
    notes.write_text("x")
    (tmp_path / "link.mcap").symlink_to(recording)
    for output in (recording, tmp_path / "link.mcap", notes, tmp_path):
        into = ("--into", EXAMPLE, "--nodes", "estimation", *mode)
        done = obk("play", recording, *into, "--output", output)
        assert done.returncode == 2
        assert f"--output {output}" in done.stderr
    assert recording.read_bytes() == before
    assert notes.read_text() == "x"


@pytest.mark.mujoco
def test_recorded_sensors_reproduce_the_recorded_estimates_exactly(tmp_path: Path) -> None:
    tests = tmp_path / "test_it.py"
    tests.write_text(TESTS.format(config=EXAMPLE))
    done = obk("test", EXAMPLE, tests, "--keep-all", "--output", tmp_path / "kept")
    assert done.returncode == 0, done.stdout
    (recording,) = (tmp_path / "kept").glob("*.mcap")
    again = tmp_path / "again.mcap"
    for node in ("estimation", "/obelisk_control_0"):
        done = obk("play", recording, "--into", EXAMPLE, "--nodes", node, "--output", again)
        assert done.returncode == 0, done.stderr
        assert "1000 messages, bit-identical to the recording" in done.stdout
    change = "onboard.estimation[0].timers[0].timer_period_sec=0.002"
    done = obk(
        "play",
        recording,
        *("--into", EXAMPLE, "--nodes", "estimation", "--output", again, "--set", change),
    )
    assert done.returncode == 0, done.stderr
    assert "differs from the first message on" in done.stdout
    assert "/obelisk/dummy/est rate [Hz]" in done.stdout
    assert len(open_run(again)["est"]) == 500
    below_a_file = ("--into", EXAMPLE, "--nodes", "estimation", "--output", tests / "x.mcap")
    done = obk("play", recording, *below_a_file)
    assert done.returncode == 1
    assert "cannot be written" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.mujoco
def test_nodes_run_as_processes_in_real_time_but_command_no_robot(tmp_path: Path) -> None:
    tests = tmp_path / "test_it.py"
    tests.write_text(TESTS.format(config=EXAMPLE))
    done = obk("test", EXAMPLE, tests, "--keep-all", "--output", tmp_path / "kept")
    assert done.returncode == 0, done.stdout
    (recording,) = (tmp_path / "kept").glob("*.mcap")
    live = tmp_path / "live.mcap"
    words = ("play", recording, "--into", EXAMPLE, "--real-time", "--output", live)

    refused = obk(*words, "--nodes", "control")
    assert refused.returncode == 1
    assert "which commands a robot" in refused.stderr
    assert not live.exists()

    # The lateness of timers on a busy machine is not tested, so any difference is accepted.
    done = obk(*words, "--nodes", "estimation", "--rate", "0.5", "--tolerance", "10")
    assert done.returncode == 0, done.stderr
    assert re.search(r"their span \(RMS\): (\d+) of \1\n", done.stdout)
    recorded, again = open_run(recording), open_run(live)
    assert again.topics == ("/obelisk/dummy/est",)
    assert len(again["est"])
    # Times are those of the recorded run, for any rate.
    first_ns = again["est"].messages.published_ns[0]
    assert 0 < first_ns < 10 * (recorded.bag.end_ns or 0)
