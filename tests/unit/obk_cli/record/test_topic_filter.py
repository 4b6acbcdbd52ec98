"""Which topics are recorded."""

from obk_cli.record.recorder_job import (
    RecordRequest,
    clashing_topics,
    matching_topics,
    unmatched_requests,
)

GRAPH = {
    "/arm/joints": ["sensor_msgs/msg/JointState"],
    "/arm/imu": ["sensor_msgs/msg/Imu"],
    "/arm/grip/_action/status": ["action_msgs/msg/GoalStatusArray"],
    "/odd": ["std_msgs/msg/Bool", "std_msgs/msg/Int8"],
}


def test_a_named_topic_of_known_type_is_recorded_before_it_exists() -> None:
    request = RecordRequest(topics={"/ctrl": "arm_msgs/msg/Torque", "/late": None})
    assert matching_topics(request, GRAPH) == {"/ctrl": "arm_msgs/msg/Torque"}


def test_a_named_topic_gets_its_type_from_the_graph() -> None:
    request = RecordRequest(topics={"/arm/imu": None})
    assert matching_topics(request, GRAPH) == {"/arm/imu": "sensor_msgs/msg/Imu"}


def test_patterns_choose_from_the_graph_and_excludes_take_away_from_everything() -> None:
    request = RecordRequest(
        topics={"/x": "a/msg/X"}, patterns=("/arm/*",), excludes=("*/imu", "/x")
    )
    assert matching_topics(request, GRAPH) == {"/arm/joints": "sensor_msgs/msg/JointState"}


def test_hidden_topics_are_recorded_only_if_a_pattern_names_them() -> None:
    assert "/arm/grip/_action/status" not in matching_topics(RecordRequest(patterns=("*",)), GRAPH)
    assert "/arm/grip/_action/status" in matching_topics(
        RecordRequest(patterns=("*/_action/*",)), GRAPH
    )


def test_the_clock_is_recorded_only_if_a_name_or_a_pattern_names_it() -> None:
    graph = {"/clock": ["rosgraph_msgs/msg/Clock"], "/clocks": ["std_msgs/msg/Int8"]}
    assert matching_topics(RecordRequest(patterns=("*",)), graph).keys() == {"/clocks"}
    for request in (RecordRequest(topics={"/clock": None}), RecordRequest(patterns=("/clock*",))):
        assert "/clock" in matching_topics(request, graph)


def test_a_topic_of_several_types_is_skipped() -> None:
    assert "/odd" not in matching_topics(RecordRequest(patterns=("*",)), GRAPH)


def test_a_topic_of_several_types_is_reported_unless_the_request_names_one() -> None:
    request = RecordRequest(topics={"/arm/imu": None, "/odd": None})
    assert clashing_topics(request, GRAPH) == {"/odd": ["std_msgs/msg/Bool", "std_msgs/msg/Int8"]}
    assert clashing_topics(RecordRequest(patterns=("/o*",)), GRAPH) == clashing_topics(
        request, GRAPH
    )
    assert not clashing_topics(RecordRequest(topics={"/odd": "std_msgs/msg/Bool"}), GRAPH)
    assert not clashing_topics(RecordRequest(patterns=("*",), excludes=("/odd",)), GRAPH)


def test_requests_that_match_no_topic_are_reported() -> None:
    request = RecordRequest(
        topics={"/arm/imu": None, "/typo": None, "/out": None},
        patterns=("/arm/*", "/amr/*"),
        excludes=("/out",),
    )
    topic, pattern = unmatched_requests(request, {"/arm/imu"})
    assert "/typo" in topic
    assert "`/amr/*`" in pattern
