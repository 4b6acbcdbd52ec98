import pytest

from obelisk_spec.suggestions import (
    ask_for,
    comparable,
    did_you_mean,
    list_names,
    near_names,
    sure_name,
    with_article,
    with_number,
)


def test_letter_case_does_not_count() -> None:
    assert near_names("OBKIMU", ["ObkImu", "other"]) == ("ObkImu",)


def test_existing_names_are_listed_if_none_is_similar() -> None:
    assert did_you_mean("zzz", ["alpha", "beta"]) == "available: `alpha`, `beta`"
    assert did_you_mean("alpa", ["alpha", "beta"]) == "did you mean `alpha`?"
    assert did_you_mean("alpa", []) is None


def test_several_names_may_be_suggested() -> None:
    assert ask_for(["alpha", "beta"]) == "did you mean `alpha` or `beta`?"
    assert ask_for([]) is None


def test_a_long_list_is_cut_and_counted() -> None:
    assert list_names("abcdef", most=2) == "`a`, `b` and 4 more"


KEYS = ("topic", "msg_type", "history_depth", "callback_group", "key")


@pytest.mark.parametrize(
    ("name", "known", "meant"),
    [
        ("topci", KEYS, "topic"),
        ("mesg_type", KEYS, "msg_type"),
        ("hsitory_dept", KEYS, "history_depth"),
        ("callbackgroup", KEYS, "callback_group"),
        ("ObkIMU", ("ObkImu", "ObkImage", "Imu"), "ObkImu"),
        ("joint_po", ("joint_pos", "joint_vel"), "joint_pos"),
        ("/dummy/jont_encoders", ("/dummy/joint_encoders", "/dummy/imu"), "/dummy/joint_encoders"),
    ],
)
def test_a_typo_has_one_meaning(name: str, known: tuple[str, ...], meant: str) -> None:
    assert sure_name(name, known) == meant


@pytest.mark.parametrize(
    ("name", "known"),
    [
        ("nothing_like_it", KEYS),
        ("joint_2", ("joint_1",)),
        ("joint2_pos", ("joint1_pos", "joint1_vel")),
        ("l_knee", ("r_knee",)),
        ("fl_hip", ("fr_hip",)),
        ("q_min", ("q_max",)),
        ("/larm/ctrl", ("/rarm/ctrl",)),
        ("kneeL", ("kneeR",)),
        ("gyrox", ("gyroz",)),
        ("topcam", ("botcam",)),
        ("joint_x", ("joint_pos", "joint_y")),
        ("poss", ("pos", "posse")),
        ("kee", ("bee", "key")),
        ("", ("a",)),
    ],
)
def test_an_ambiguous_name_has_none(name: str, known: tuple[str, ...]) -> None:
    assert sure_name(name, known) is None


def test_too_many_or_too_long_names_are_not_compared() -> None:
    many = [f"joint_{i:04}_x" for i in range(1_000)]
    assert comparable("joint_000_x", many) == ()
    assert comparable("knee_pitc_h", [*many, "knee_pitch"]) == ("knee_pitch",)
    assert comparable("a" * 101, ["a" * 100]) == ()


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("hinge", "a `hinge`"),
        ("ellipsoid", "an `ellipsoid`"),
        ("ObkImu", "an `ObkImu`"),
        ("obelisk_control_msgs/PositionSetpoint", "an `obelisk_control_msgs/PositionSetpoint`"),
        ("UInt16", "a `UInt16`"),
    ],
)
def test_a_name_has_the_article_of_its_pronunciation(name: str, expected: str) -> None:
    assert with_article(name) == expected


def test_a_noun_is_in_the_plural_unless_it_is_one() -> None:
    assert [with_number(n, "node") for n in (0, 1, 2)] == ["0 nodes", "1 node", "2 nodes"]
