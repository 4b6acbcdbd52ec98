"""Recordings of running stacks, read with the MCAP library and the compiled messages."""

import importlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from std_msgs.msg import Int32

from obk_cli.record.recorder_job import RecorderJob, RecordRequest, job_to_json

from .stack import DEADLINE_S, DUMMY, EXAMPLE, OBK, arguments_of, eventually, launched, obk

pytestmark = pytest.mark.ros

ENCODERS = "/obelisk/dummy/joint_encoders"
IMU = "/obelisk/dummy/imu"


@dataclass(slots=True, kw_only=True)
class Read:
    """The messages of one topic, as found by a reader independent of obk."""

    msg_type: str = ""
    qos: str = ""
    numbers: list[int] = field(default_factory=list)
    messages: list[Any] = field(default_factory=list)


def read_back(path: Path) -> dict[str, Read]:
    found: dict[str, Read] = {}
    with path.open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            read = found.setdefault(channel.topic, Read(msg_type=schema.name))
            read.qos = channel.metadata["offered_qos_profiles"]
            package, _, name = schema.name.split("/")
            kind = getattr(importlib.import_module(f"{package}.msg"), name)
            read.numbers.append(message.sequence)
            read.messages.append(deserialize_message(message.data, kind))
    return found


def stamp_s(message: Any) -> float:
    """Time of a message's header [s]."""
    stamp = message.header.stamp
    return float(stamp.sec + stamp.nanosec * 1e-9)


def only_run() -> Path:
    (run,) = Path(os.environ["OBK_HOME"], "runs").glob("dummy_*")
    return run


def reported(recording: Path) -> dict[str, Any]:
    result = obk("bag", "info", recording, "--format", "json")
    assert result.returncode == 0, result.stderr
    return dict(json.loads(result.stdout))


def counts(path: Path, *wanted: str) -> dict[str, int]:
    """Topic -> number of messages in a file that is being written, waiting for the given topics."""
    result = obk("bag", "info", path, "--format", "json")
    topics = json.loads(result.stdout)["topics"] if result.returncode == 0 else []
    found = {topic["topic"]: topic["count"] for topic in topics if topic["count"]}
    return dict.fromkeys(wanted, 0) | found


def test_a_recorded_launch_has_every_message_to_the_last() -> None:
    result = obk("launch", EXAMPLE, "--record", "--duration", "2", "--color", "never")
    assert result.returncode == 0, result.stdout + result.stderr
    assert result.stdout.splitlines()[-1] == "stopped cleanly"
    run = only_run()
    for folder in (run, run.parent):
        assert folder.stat().st_mode & 0o077 == 0  # recordings and logs belong to their owner
    found = read_back(run / "recording.mcap")
    lost = {topic["topic"]: topic["lost"] for topic in reported(run / "recording.mcap")["topics"]}
    assert set(found) == set(lost)
    assert len(found) == 6
    for topic, read in found.items():
        first, *_, last = read.numbers
        assert len(read.numbers) + lost[topic] == last - first + 1, topic
    # The simulator publishes to a topic from the time when DDS has matched its recorder, and at the
    # end, DDS may lose what it has not delivered yet.
    stamps = {topic: list(map(stamp_s, found[topic].messages)) for topic in (ENCODERS, IMU)}
    assert abs(stamps[ENCODERS][-1] - stamps[IMU][-1]) < 0.1
    assert stamps[IMU] == sorted(stamps[IMU])
    (qos,) = yaml.safe_load(found[IMU].qos)
    assert (qos["reliability"], qos["durability"]) == ("reliable", "volatile")


def test_a_recording_starts_with_its_config() -> None:
    with launched(DUMMY, "--record-topic", "*/imu"):
        run = only_run()
        eventually(lambda: counts(run / "recording.mcap"), "a message in the file")
    made = json.loads((run / "run.json").read_text())
    with (run / "recording.mcap").open("rb") as file:
        reader = make_reader(file)
        texts = {one.name: one.data.decode() for one in reader.iter_attachments()}
        records = {one.name: one.metadata for one in reader.iter_metadata()}
    assert json.loads(texts["plan.json"]) == made["plan"]
    assert texts["params/obelisk_robot_0.yaml"] == (
        run / "params" / "obelisk_robot_0.yaml"
    ).read_text(encoding="utf-8")
    assert records["obelisk"]["plan_sha256"] == made["plan_sha256"]
    assert records["obelisk_versions"] == made["versions"]
    assert set(read_back(run / "recording.mcap")) == {IMU}


def test_a_recorder_for_which_ros_does_not_start_reports_it(tmp_path: Path) -> None:
    job = tmp_path / "recording.json"
    job.write_text(
        job_to_json(
            RecorderJob(path=tmp_path / "recording.mcap", request=RecordRequest(patterns=("*",)))
        )
    )
    result = subprocess.run(
        [sys.executable, "-m", "obk_cli.record.recorder", job],
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        check=False,
        env={**os.environ, "ROS_DOMAIN_ID": "mine"},
    )
    assert (result.returncode, result.stderr) == (1, "")
    (line,) = result.stdout.splitlines()
    assert line.startswith("ROS 2 does not start: ")
    assert "ROS_DOMAIN_ID " in line
    assert not (tmp_path / "recording.mcap").exists()


def test_a_killed_recorder_leaves_its_messages_and_the_stack_continues() -> None:
    with launched(DUMMY, "--record", "--quiet") as run:
        recording = only_run() / "recording.mcap"
        eventually(lambda: sum(counts(recording).values()) > 20, "messages in the file")
        (recorder,) = (p for p in run.descendants if "obk_cli.record.recorder" in arguments_of(p))
        assert recorder.environ()["OBK_RUN"] == only_run().name
        states = json.loads(obk("lifecycle", "get", "--format", "json").stdout)
        assert len(states) == 3  # it is not a node of the stack
        recorder.kill()
        run.wait_for_line("warning: the recorder stopped: the process was terminated by SIGKILL")
    assert run.process.returncode == 0, run.text
    assert "stopped cleanly" in run.lines
    assert not run.left_over()
    bag = reported(recording)
    assert bag["count"] > 20
    assert not bag["is_complete"]
    assert bag["metadata"]["obelisk"]["name"] == "dummy"
    with recording.open("rb") as file:
        first = next(iter(StreamReader(file).records))
    assert type(first).__name__ == "Header"


def test_a_killed_launcher_leaves_a_whole_recording() -> None:
    with launched(DUMMY, "--record", "--quiet") as run:
        recording = only_run() / "recording.mcap"
        eventually(lambda: counts(recording), "messages in the file")
        run.process.kill()
        eventually(lambda: not run.left_over(), f"the end of {run.descendants}")
    assert reported(recording)["is_complete"]


def test_topics_of_a_running_stack_are_recorded_and_drawn(tmp_path: Path) -> None:
    path = tmp_path / "some.mcap"
    with launched(DUMMY, "--quiet"):
        with recorder(path, "*/imu", ENCODERS, "--exclude", "*obk_*"):
            eventually(lambda: min(counts(path, IMU, ENCODERS).values()) > 3, "messages of both")
        short = obk("record", "--duration", "0.1", "-o", tmp_path / "short.mcap")
        count = re.match("recorded ([0-9]+) message", short.stdout)
        assert count is not None, short.stderr
        assert (short.returncode == 0) == (int(count[1]) > 0)
        again = obk("record", "--duration", "1", "-o", path)
        assert again.returncode == 1
        assert str(path) in again.stderr
    assert set(read_back(path)) == {IMU, ENCODERS}
    assert reported(path)["metadata"]["obelisk"]["name"] == "dummy"
    picture = tmp_path / "imu.svg"
    drawn = obk("plot", path, "imu.angular_velocity", "joint_encoders.y", "-o", picture)
    assert drawn.returncode == 0, drawn.stderr
    assert ">imu.angular_velocity [rad/s]<" in picture.read_text(encoding="utf-8")


def test_a_recording_without_messages_fails(tmp_path: Path) -> None:
    result = obk("record", "/nothing", "--duration", "0.2", "-o", tmp_path / "empty.mcap")
    assert result.returncode == 1
    assert "/nothing was not found" in result.stderr
    assert result.stdout.startswith("recorded 0 messages")


def test_without_a_stack_and_without_topics_nothing_is_recorded(tmp_path: Path) -> None:
    result = obk("record", "-o", tmp_path / "none.mcap")
    assert result.returncode == 1
    assert "ROS domain" in result.stderr
    assert not (tmp_path / "none.mcap").exists()


@contextmanager
def recorder(path: Path, *words: str) -> Iterator["subprocess.Popen[str]"]:
    """A running `obk record` that is receiving; stopped by SIGINT."""
    process = subprocess.Popen(
        [OBK, "record", "-o", path, *words], stderr=subprocess.PIPE, text=True
    )
    try:
        assert process.stderr is not None
        with process.stderr as errors:
            assert errors.readline().startswith("recording to ")
            yield process
    finally:
        process.send_signal(2)
        process.wait(DEADLINE_S)


def test_publishers_that_offer_less_or_more_are_received(tmp_path: Path) -> None:
    """One publisher is unreliable; the other one published before any subscription existed."""
    path = tmp_path / "odd.mcap"
    rclpy.init()
    try:
        node = rclpy.create_node("odd")
        latched_qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        weak_qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        latched = node.create_publisher(Int32, "/latched", latched_qos)
        weak = node.create_publisher(Int32, "/weak", weak_qos)
        latched.publish(Int32(data=7))
        with recorder(path, "/latched", "/we*"):

            def is_published() -> bool:
                weak.publish(Int32(data=8))
                return set(counts(path)) == {"/latched", "/weak"}

            eventually(is_published, "messages of both")
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    found = read_back(path)
    assert [message.data for message in found["/latched"].messages] == [7]
    assert {message.data for message in found["/weak"].messages} == {8}
    assert yaml.safe_load(found["/latched"].qos)[0]["durability"] == "transient_local"
