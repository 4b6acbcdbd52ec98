"""The result of a run, by name, with topics built by hand and without nodes."""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Pose, PoseArray, PoseStamped, PoseWithCovariance
from obelisk_estimator_msgs.msg import EstimatedState
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Float64, Float64MultiArray

from obelisk_py.core.lockstep.topics import Topic
from obk_cli.plan.plan import Plan
from obk_testing.result import StateLog, TrialFacts, TrialResult
from obk_testing.topic_log import TopicLog

PLAN = Plan(name="stack", nodes=())
MS = 1_000_000


class FakeModel:
    """A model with one hinge."""

    njnt = 1
    jnt_type = (3,)
    jnt_qposadr = (0,)

    def joint(self, number: int) -> Any:
        return SimpleNamespace(name="elbow")


def states(*angles: float) -> StateLog:
    log = StateLog("/robot", FakeModel())
    for number, angle in enumerate(angles):
        log.add(number * MS, np.array([angle]), np.zeros(1))
    return log


def topic(name: str, *messages: Any, begin_place: int = 0, times_ms: Iterable[int] = ()) -> Topic:
    """A topic that published these messages, by default one per millisecond."""
    made = Topic(name, type(messages[0]), is_watched=False)
    times = [*times_ms] or range(len(messages))
    made.log = [
        (time * MS, begin_place + number, made.codec.pack(message))
        for number, (time, message) in enumerate(zip(times, messages, strict=True))
    ]
    return made


def result(*topics: Topic, ways: Mapping[str, str] | None = None, states: Any = None) -> Any:
    return TrialResult(
        facts=TrialFacts(config=Path("stack.yaml"), plan=PLAN),
        duration_s=1.0,
        topics={one.label: one for one in topics},
        states=states,
        faults=(),
        notes=(),
        log=(),
        ways=ways or {},
    )


def pose(x: float, stamp_s: int = 0) -> PoseStamped:
    message = PoseStamped()
    message.header.stamp.sec = stamp_s
    message.pose.position.x = x
    message.pose.position.y = 2 * x
    return message


def estimate(*positions: float) -> EstimatedState:
    message = EstimatedState()
    message.q_joints = list(positions)
    message.joint_names = ["shoulder", "elbow"]
    return message


def numbers(*values: float) -> list[Float64]:
    return [Float64(data=value) for value in values]


def test_a_field_is_an_array_with_a_row_for_each_message() -> None:
    run = result(topic("/est", estimate(1, 2), estimate(3, 4)))
    assert run["/est"].q_joints.tolist() == [[1, 2], [3, 4]]
    assert run["/est"].t.tolist() == [0.0, 0.001]
    assert run["/est"]["q_joints[1]"].tolist() == [2, 4]


def test_a_field_of_a_field_by_attribute_and_by_path() -> None:
    poses = result(topic("/pose", pose(1), pose(2)))["/pose"]
    assert poses.pose.position.x.tolist() == [1, 2]
    assert poses["pose.position.y"].tolist() == [2, 4]
    assert poses["header.stamp.sec"].tolist() == [0, 0]


def test_a_message_in_a_message_is_an_array_of_its_numbers() -> None:
    position = result(topic("/pose", pose(1), pose(2)))["/pose"].pose.position
    assert np.asarray(position).tolist() == [[1, 2, 0], [2, 4, 0]]
    assert position[-1].tolist() == [2, 4, 0]
    assert np.linalg.norm(position, axis=1).shape == (2,)


def test_stamps_are_those_of_the_headers() -> None:
    poses = result(topic("/pose", pose(1, stamp_s=7)))["/pose"]
    assert poses.stamps.tolist() == [7.0]
    with pytest.raises(LookupError, match="no header"):
        _ = result(topic("/x", *numbers(1)))["/x"].stamps


def test_a_joint_by_its_name() -> None:
    log = result(topic("/est", estimate(1, 2), estimate(3, 4)))["/est"]
    assert log.joint("elbow", "q_joints").tolist() == [2, 4]
    with pytest.raises(LookupError, match="did you mean `elbow`"):
        log.joint("elbw", "q_joints")


def test_units_are_those_of_the_definition() -> None:
    log = result(topic("/est", estimate(1, 2)))["/est"]
    assert log.unit("q_joints") == log.unit("q_joints[1]") == "rad or m"
    assert log.unit("joint_names") is None
    assert log.unit("nothing") is None
    assert log.unit("q_base") is None, "position and orientation"
    assert log.unit("v_base") is None, "two units"
    assert log.unit("header.stamp.sec") is None


def test_the_latest_message_at_a_time() -> None:
    log = result(topic("/x", *numbers(1, 2), times_ms=(10, 20)))["/x"]
    assert log.at(0.015).data == 1
    assert log.at(0.02).data == 2
    with pytest.raises(LookupError, match="no message by"):
        log.at(0.005)
    with pytest.raises(ValueError, match="nan"):
        log.at(math.nan)


def test_a_misspelled_topic_and_field_get_a_suggestion() -> None:
    run = result(topic("/arm/est", estimate(1, 2)), ways={"/imu": "/imu: no node subscribes"})
    with pytest.raises(LookupError, match="did you mean `/arm/est`"):
        run["/arm/ets"]
    with pytest.raises(LookupError, match="no node subscribes"):
        run["/imu"]
    with pytest.raises(AttributeError, match="did you mean `q_joints`"):
        _ = run["/arm/est"].q_joint
    with pytest.raises(LookupError, match="no field"):
        run["/arm/est"]["header.stmp"]


def test_arrays_of_varying_length_are_named() -> None:
    messages = (Float64MultiArray(data=[1.0]), Float64MultiArray(data=[1.0, 2.0]))
    log = result(topic("/x", *messages))["/x"]
    with pytest.raises(LookupError, match="varies"):
        _ = log.data
    with pytest.raises(LookupError, match="only 1 item"):
        log["data[1]"]


def test_a_result_ends_at_its_time() -> None:
    made = topic("/x", *numbers(1, 2))
    run = result(made)
    assert made.log is not None
    made.log.append((5 * MS, 9, made.codec.pack(Float64(data=3.0))))
    assert run["/x"].data.tolist() == [1, 2]
    assert len(run["/x"]) == 2


def test_topics_read_by_a_test_are_recorded() -> None:
    run = result(topic("/pose", pose(1)))
    _ = run["/pose"].pose.position.x
    assert ("/pose", "pose.position.x") in run.facts.looked_at


def test_two_runs_with_the_same_messages_have_one_digest() -> None:
    one, two, other = (result(topic("/x", *numbers(*v))) for v in ((1, 2), (1, 2), (1, 3)))
    assert one.digest() == two.digest() != other.digest()
    assert one.first_difference(two) is None
    assert one.first_difference(other) == "0.001000 s: message 1 of /x: `data`"


def test_of_several_topics_the_first_published_is_the_difference() -> None:
    """`/a` follows from `/z`, at the same time."""
    one = result(topic("/z", *numbers(1)), topic("/a", *numbers(1), begin_place=1))
    two = result(topic("/z", *numbers(2)), topic("/a", *numbers(2), begin_place=1))
    assert "/z" in one.first_difference(two)


def test_a_missing_message_is_a_difference() -> None:
    one, two = result(topic("/x", *numbers(1, 2))), result(topic("/x", *numbers(1)))
    assert one.first_difference(two) == "0.001000 s: /x has 2 and 1 messages"


def test_close_to_shows_the_greatest_difference() -> None:
    one = result(topic("/est", estimate(1, 2), estimate(3, 4)))
    two = result(topic("/est", estimate(1, 2), estimate(3, 4.25)))
    assert one.close_to(two, atol=0.3, fields=["/est.q_joints"])
    comparison = one.close_to(two, atol=0.1, fields=["/est.q_joints"])
    assert not comparison
    assert repr(comparison) == "/est.q_joints[1] differs by 0.25 at 0.001 s, more than 0.1"


def test_close_to_accepts_equal_infinities() -> None:
    one, two, other = (
        result(topic("/scan", LaserScan(ranges=values)))
        for values in ([np.inf, -np.inf, 1.0], [np.inf, -np.inf, 1.25], [np.inf, np.inf, 1.0])
    )
    assert one.close_to(one, atol=0.0, fields=["/scan.ranges"])
    assert one.close_to(two, atol=0.3, fields=["/scan.ranges"])
    assert "ranges[2] differs by 0.25" in repr(one.close_to(two, atol=0.1, fields=["/scan.ranges"]))
    assert "ranges[1] differs by inf" in repr(one.close_to(other, atol=1, fields=["/scan.ranges"]))


@pytest.mark.parametrize("place", [0, 35])
def test_the_first_difference_names_the_field_with_other_bits(place: int) -> None:
    one, two = (PoseWithCovariance(covariance=[1.0] * 36) for _ in range(2))
    two.covariance[place] += 1e-12
    for message in (one, two):
        message.pose.position.x = math.nan
    first, second = (result(topic("/x", message)) for message in (one, two))
    assert first.first_difference(second) == "0.000000 s: message 0 of /x: `covariance`"


def test_a_joint_of_the_simulator_by_its_name() -> None:
    run = result(states=states(0.1, 0.2))
    assert run.joint("elbow").tolist() == [0.1, 0.2]
    assert run.t.tolist() == [0.0, 0.001]
    assert ("joint", "elbow") in run.facts.looked_at
    with pytest.raises(LookupError, match="did you mean `elbow`"):
        run.joint("elbo")


def test_runs_of_different_lengths_differ_after_the_shorter_one() -> None:
    one, two = result(states=states(0.1, 0.2)), result(states=states(0.1))
    difference = "0.001000 s: the simulator took 2 and 1 steps"
    assert one.first_difference(two) == difference
    assert two.first_difference(one) == difference.replace("2 and 1", "1 and 2")


def test_close_to_compares_the_positions_of_the_simulator() -> None:
    one, two = result(states=states(0.1, 0.2)), result(states=states(0.1, 0.25))
    assert one.close_to(two, atol=0.1)
    assert "qpos[0] differs by 0.05" in repr(one.close_to(two, atol=0.01))
    assert one.first_difference(two) == "0.001000 s: the state of the simulator"


def test_close_to_needs_something_to_compare() -> None:
    one = result(topic("/est", estimate(1, 2)))
    with pytest.raises(LookupError, match="no MuJoCo simulator"):
        one.close_to(one, atol=1.0)


def test_a_log_without_messages_still_knows_its_fields() -> None:
    log = TopicLog("/x", Float64, (), bytes)
    assert log.data.shape == (0,)
    with pytest.raises(AttributeError, match="no field"):
        _ = log.dta
    poses = TopicLog("/x", PoseArray, (), bytes)
    assert poses.header.stamp.sec.shape == (0,)
    assert poses["poses[0].position.x"].shape == (0,)
    assert np.asarray(poses.header.stamp).shape == (0,)


@pytest.mark.parametrize("messages", [(), (PoseArray(poses=[Pose()]),)])
@pytest.mark.parametrize(
    "path", ["header.stamp.secs", "poses.position", "poses[0].position.w", "header[0]", "frame"]
)
def test_every_name_in_a_path_is_checked(messages: tuple[PoseArray, ...], path: str) -> None:
    made = topic("/x", *messages) if messages else topic("/x", PoseArray())
    log = TopicLog("/x", PoseArray, (made.log or ())[: len(messages)], made.codec.unpack)
    with pytest.raises(LookupError):
        log[path]


def test_a_log_without_messages_can_be_a_mistake() -> None:
    log = TopicLog("/x", EstimatedState, (), bytes, why_unpublished="no node subscribes")
    assert len(log) == len(log.t) == 0
    for read in (
        lambda: log.q_joints,
        lambda: log["q_joints"],
        lambda: log.stamps,
        lambda: log.at(0.1),
        lambda: log.joint("elbow", "q_joints"),
    ):
        with pytest.raises(LookupError, match="no node subscribes"):
            read()
    with pytest.raises(AttributeError, match="no field"):
        _ = log.q_joint


def test_close_to_needs_values() -> None:
    empty = topic("/x", Float64())
    empty.log = []
    one, two = result(empty), result(topic("/x", *numbers(1)))
    for comparison in (
        one.close_to(one, atol=1.0, fields=["/x.data"]),
        one.close_to(two, atol=1.0, fields=["/x.data"]),
    ):
        assert not comparison
