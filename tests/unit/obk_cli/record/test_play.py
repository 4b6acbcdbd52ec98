"""Which recorded topics may be published again, and when each message is due."""

import json
from pathlib import Path

import pytest

from obelisk_recordings.chunks import RecordedMessage
from obelisk_recordings.run import RecordedRun, open_run
from obk_cli.errors import CommandFailedError
from obk_cli.record.mcap_writer import BagWriter
from obk_cli.record.play import paced, playable_topics

PLAN = {
    "processes": [
        {"node": "robot", "section": "robot", "subscribes": [{"topic": "/legs/torques"}]},
        {"node": "est", "section": "estimation", "subscribes": [{"topic": "/legs/imu"}]},
    ]
}
TYPES = {
    "/legs/imu": "sensor_msgs/msg/Imu",
    "/legs/torques": "my_msgs/msg/Torques",
    "/arm/ctrl": "obelisk_control_msgs/msg/PositionSetpoint",
    "/silent": "sensor_msgs/msg/Imu",
}


@pytest.fixture
def run(tmp_path: Path) -> RecordedRun:
    path = tmp_path / "legs.mcap"
    with BagWriter(path) as writer:
        writer.describe({}, {"plan.json": json.dumps(PLAN)}, 0)
        for name, kind in TYPES.items():
            channel = writer.add_topic(name, kind, "float64 x\n", {})
            if name != "/silent":
                writer.add_message(channel, b"\0\1\0\0" + bytes(8), 1, 1, 1)
    return open_run(path)


def test_commands_by_the_config_or_by_the_type_are_left_out(run: RecordedRun) -> None:
    chosen, left_out = playable_topics(run, [], may_move=False)
    assert chosen == ["/legs/imu"]
    assert sorted(left_out) == ["/arm/ctrl", "/legs/torques"]


@pytest.mark.parametrize("name", ["/arm/ctrl", "/legs/torques"])
def test_a_command_that_is_named_is_refused_unless_on_purpose(run: RecordedRun, name: str) -> None:
    with pytest.raises(CommandFailedError, match=f"`{name}`, which commands a robot"):
        playable_topics(run, [name], may_move=False)
    assert playable_topics(run, [name], may_move=True) == ([name], [])


def test_a_topic_without_a_message_cannot_be_published(run: RecordedRun) -> None:
    with pytest.raises(CommandFailedError, match="no message"):
        playable_topics(run, ["/silent"], may_move=False)


def test_messages_are_due_by_their_publication() -> None:
    messages = [
        RecordedMessage(
            topic="/a", msg_type="", received_ns=0, published_ns=ns, sequence=0, data=b""
        )
        for ns in (5_000_000_000, 4_900_000_000, 5_500_000_000, 7_000_000_000)
    ]
    assert [due_s for due_s, _ in paced(messages, 2.0)] == [0.0, 0.0, 0.25, 1.0]
