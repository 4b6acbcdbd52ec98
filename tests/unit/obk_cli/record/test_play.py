"""The recorded topics that may be published again, and when each message is due."""

import json
import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from obelisk_recordings.chunks import RecordedMessage, messages_in_order
from obelisk_recordings.clock import RecordedClock
from obelisk_recordings.run import RecordedRun, open_run
from obk_cli.errors import CommandFailedError
from obk_cli.plan.plan import Endpoint, Plan
from obk_cli.record.compare import FirstDifference, first_different_message
from obk_cli.record.mcap_writer import BagWriter
from obk_cli.record.play import paced, playable_topics, refuse_live_topic
from obk_cli.record.rewrite import rewrite
from obk_cli.ros.graph import GraphEndpoint, TopicInfo

from ..plans import node  # noqa: TID252 - shared by folders of tests

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
def test_a_named_command_is_rejected_unless_allowed(run: RecordedRun, name: str) -> None:
    with pytest.raises(CommandFailedError, match=f"`{name}`: this would command a robot"):
        playable_topics(run, [name], may_move=False)
    assert playable_topics(run, [name], may_move=True) == ([name], [])


def test_a_topic_without_a_message_cannot_be_published(run: RecordedRun) -> None:
    with pytest.raises(CommandFailedError, match="no message"):
        playable_topics(run, ["/silent"], may_move=False)


def test_messages_are_due_by_their_publication() -> None:
    messages = [
        RecordedMessage(topic="/a", received_ns=0, published_ns=ns, sequence=0, data=b"")
        for ns in (5_000_000_000, 4_900_000_000, 5_500_000_000, 7_000_000_000)
    ]
    assert [due_s for due_s, _ in paced(messages, 2.0)] == [0.0, 0.0, 0.25, 1.0]


SECOND = 1_000_000_000
HEADER = """\
std_msgs/Header header
float64 x
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def stamped_run(path: Path, *, is_simulated: bool) -> RecordedRun:
    """Stamps of 1, 2 and 3 s, half a second apart, and a topic without stamps."""
    parameters = {"use_sim_time": True} if is_simulated else {}
    plan = {"processes": [{"node": "est", "section": "estimation", "parameters": parameters}]}
    with BagWriter(path) as writer:
        writer.describe({}, {"plan.json": json.dumps(plan)}, 0)
        stamped = writer.add_topic("/imu", "my_msgs/msg/Imu", HEADER, {})
        bare = writer.add_topic("/joy", "my_msgs/msg/Joy", "float64 x\n", {})
        for number in range(3):
            time_ns = 100 * SECOND + number * SECOND // 2
            data = struct.pack("<4sIIIxxxxd", b"\0\1\0\0", number + 1, 0, 0, 7.0)
            writer.add_message(stamped, data, time_ns, time_ns, number)
        writer.add_message(bare, b"\0\1\0\0" + bytes(8), time_ns + 1, time_ns + 1, 1)
    return open_run(path)


@pytest.mark.parametrize(
    ("is_simulated", "seconds"),
    [(True, [1.0, 2.0, 3.0, 3.0]), (False, [100.0, 100.5, 101.0, 101.0])],
)
def test_replayed_nodes_have_the_time_of_the_recorded_ones(
    tmp_path: Path, is_simulated: bool, seconds: list[float]
) -> None:
    run = stamped_run(tmp_path / "a.mcap", is_simulated=is_simulated)
    clock = RecordedClock(run)
    times = [
        clock.time_ns(one.published_ns) / SECOND for one in messages_in_order(run.path, run.topics)
    ]
    assert times == pytest.approx(seconds)
    between_s = clock.time_ns(round(100.25 * SECOND)) / SECOND
    assert between_s == pytest.approx(1.5 if is_simulated else 100.25)
    back = [clock.published_ns(round(one * SECOND)) / SECOND for one in (0.5, 1.0, 1.5, 2.0, 4.0)]
    assert back == ([99.5, 100.0, 100.25, 100.5, 102.0] if is_simulated else [0.5, 1, 1.5, 2, 4])


@pytest.mark.parametrize(
    ("stamps_s", "time_s"), [({"/imu": 2, "/joy": 1000}, 2), ({"/imu": 999, "/joy": 1000}, 1000)]
)
def test_stamps_in_wall_time_do_not_move_simulated_time(
    tmp_path: Path, stamps_s: dict[str, int], time_s: int
) -> None:
    path = tmp_path / "a.mcap"
    plan = {"processes": [{"node": "est", "parameters": {"use_sim_time": True}}]}
    with BagWriter(path) as writer:
        writer.describe({}, {"plan.json": json.dumps(plan)}, 0)
        for name, stamp_s in stamps_s.items():
            channel = writer.add_topic(name, "my_msgs/msg/Imu", HEADER, {})
            data = struct.pack("<4sIIIxxxxd", b"\0\1\0\0", stamp_s, 0, 0, 7.0)
            writer.add_message(channel, data, 1000 * SECOND, 1000 * SECOND, 0)
    assert RecordedClock(open_run(path)).time_ns(1000 * SECOND) == time_s * SECOND


@pytest.mark.parametrize(
    "processes",
    [None, 1, [1], [{"parameters": 1, "subscribes": 1}], [{"subscribes": [1]}]],
)
def test_a_plan_of_another_program_is_ignored(tmp_path: Path, processes: object) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.describe({}, {"plan.json": json.dumps({"processes": processes})}, 0)
        imu = writer.add_topic("/imu", "my_msgs/msg/Imu", "float64 x\n", {})
        writer.add_message(imu, b"\0\1\0\0" + bytes(8), SECOND, SECOND, 0)
    run = open_run(tmp_path / "a.mcap")
    assert playable_topics(run, [], may_move=False) == (["/imu"], [])
    (message,) = messages_in_order(run.path, run.topics)
    assert RecordedClock(run).time_ns(message.published_ns) == SECOND


def test_a_rewritten_recording_has_the_same_messages_at_other_times(tmp_path: Path) -> None:
    run = stamped_run(tmp_path / "a.mcap", is_simulated=False)
    rewrite(run, tmp_path / "b.mcap", ["/imu"], lambda ns: ns // 2, {"obelisk": {"a": "b"}})
    again = open_run(tmp_path / "b.mcap")
    assert again.topics == ("/imu",)
    assert again["imu"].x.tolist() == run["imu"].x.tolist()
    expected = run["imu"].messages.published_ns // 2
    assert again["imu"].messages.published_ns.tolist() == expected.tolist()
    assert again.metadata["obelisk"] == {"a": "b"}
    assert again.plan == run.plan


@pytest.mark.parametrize("is_lockstep", [True, False])
def test_only_in_lockstep_must_messages_come_at_the_same_time(
    tmp_path: Path, is_lockstep: bool
) -> None:
    source = stamped_run(tmp_path / "a.mcap", is_simulated=False)
    about = {"obelisk": {"lockstep": "true"} if is_lockstep else {}}
    rewrite(source, tmp_path / "b.mcap", ["/imu"], lambda ns: ns, about)
    rewrite(source, tmp_path / "c.mcap", ["/imu"], lambda ns: ns + SECOND // 8, about)
    first, later = open_run(tmp_path / "b.mcap"), open_run(tmp_path / "c.mcap")
    same = FirstDifference(count=3, at_s=None)
    assert first_different_message(first, first, "/imu") == same
    late = FirstDifference(count=0, at_s=100.0, late_s=0.125)
    assert first_different_message(first, later, "/imu") == (late if is_lockstep else same)


def test_a_difference_has_no_negative_time_and_counts_no_messages_without_equal_ones() -> None:
    before = str(FirstDifference(count=0, at_s=-0.0358))
    assert "0.0358 s before activation" in before
    assert "-0.0358" not in before
    assert "identical" not in before
    assert "identical up to message 2" in str(FirstDifference(count=2, at_s=0.5))


NODE, LOOK = "/obelisk_estimation_0", "/obk_look_1"


def live(name: str, *publishers: str) -> TopicInfo:
    ends = tuple(
        GraphEndpoint(node=node, role="publisher", msg_type="a/msg/B", qos=cast(Any, None))
        for node in publishers
    )
    return TopicInfo(name=name, msg_types=("a/msg/B",), publishers=ends)


def domain(*plans: Plan) -> Any:
    return SimpleNamespace(domain=7, plans=plans)


ROBOT_NAME = "/obelisk_robot_0"


@pytest.mark.parametrize(
    ("topic", "nodes", "is_refused"),
    [
        (live("/est", NODE, LOOK), (NODE, ROBOT_NAME), True),
        (live("/est", NODE), (NODE,), False),
        (live("/est", LOOK), (NODE, ROBOT_NAME), False),
        (live("/rosout", NODE), (NODE, ROBOT_NAME), False),
    ],
)
def test_a_topic_is_not_replayed_among_live_messages_of_a_robots_stack(
    topic: TopicInfo, nodes: tuple[str, ...], is_refused: bool
) -> None:
    if not is_refused:
        refuse_live_topic(topic, domain(), nodes, LOOK)
        return
    with pytest.raises(CommandFailedError, match=f"/est is published by `{NODE}`") as raised:
        refuse_live_topic(topic, domain(), nodes, LOOK)
    assert "--allow-hardware" in str(raised.value.help)


def test_publishers_in_the_plan_count_before_they_appear() -> None:
    robot = node("robot", "robot")
    est = node("est", "estimation", publishes=(Endpoint(topic="/est", msg_type=None),))
    with pytest.raises(CommandFailedError, match="/est is published by `/est`"):
        refuse_live_topic(live("/est"), domain(Plan(name="a", nodes=(robot, est))), (), LOOK)
    refuse_live_topic(live("/est"), domain(Plan(name="a", nodes=(est,))), (), LOOK)
