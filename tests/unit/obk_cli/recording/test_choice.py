"""Which topics are recorded."""

from obk_cli.recording.choice import Wish, chosen_topics, clashing_topics, unmet_wishes

GRAPH = {
    "/arm/joints": ["sensor_msgs/msg/JointState"],
    "/arm/imu": ["sensor_msgs/msg/Imu"],
    "/arm/grip/_action/status": ["action_msgs/msg/GoalStatusArray"],
    "/odd": ["std_msgs/msg/Bool", "std_msgs/msg/Int8"],
}


def test_a_named_topic_of_known_type_is_recorded_before_it_is_there() -> None:
    wish = Wish(topics={"/ctrl": "arm_msgs/msg/Torque", "/late": None})
    assert chosen_topics(wish, GRAPH) == {"/ctrl": "arm_msgs/msg/Torque"}


def test_a_named_topic_gets_its_type_from_the_graph() -> None:
    wish = Wish(topics={"/arm/imu": None})
    assert chosen_topics(wish, GRAPH) == {"/arm/imu": "sensor_msgs/msg/Imu"}


def test_patterns_choose_from_the_graph_and_excludes_take_away_from_everything() -> None:
    wish = Wish(topics={"/x": "a/msg/X"}, patterns=("/arm/*",), excludes=("*/imu", "/x"))
    assert chosen_topics(wish, GRAPH) == {"/arm/joints": "sensor_msgs/msg/JointState"}


def test_hidden_topics_are_recorded_only_where_a_pattern_is_about_them() -> None:
    assert "/arm/grip/_action/status" not in chosen_topics(Wish(patterns=("*",)), GRAPH)
    assert "/arm/grip/_action/status" in chosen_topics(Wish(patterns=("*/_action/*",)), GRAPH)


def test_a_topic_of_several_types_is_none() -> None:
    assert "/odd" not in chosen_topics(Wish(patterns=("*",)), GRAPH)


def test_a_topic_of_several_types_is_told_unless_one_is_wished_for() -> None:
    wish = Wish(topics={"/arm/imu": None, "/odd": None})
    assert clashing_topics(wish, GRAPH) == {"/odd": ["std_msgs/msg/Bool", "std_msgs/msg/Int8"]}
    assert clashing_topics(Wish(patterns=("/o*",)), GRAPH) == clashing_topics(wish, GRAPH)
    assert not clashing_topics(Wish(topics={"/odd": "std_msgs/msg/Bool"}), GRAPH)
    assert not clashing_topics(Wish(patterns=("*",), excludes=("/odd",)), GRAPH)


def test_what_nothing_was_recorded_of_is_told() -> None:
    wish = Wish(
        topics={"/arm/imu": None, "/typo": None, "/out": None},
        patterns=("/arm/*", "/amr/*"),
        excludes=("/out",),
    )
    told = ["/typo was not there", "no topic fitted `/amr/*`"]
    assert list(unmet_wishes(wish, {"/arm/imu"})) == told
