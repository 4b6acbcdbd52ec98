import pytest

from obk_cli.config.model import Stack
from obk_cli.config.reader import read_stack
from obk_cli.config.topology import stack_endpoints
from obk_cli.config.yaml_parser import parse_source
from obk_cli.diagnostics.source import SourceFile


def stack(text: str) -> Stack:
    parsed = parse_source(SourceFile.of("f.yaml", text))
    assert parsed.tree is not None
    read, _ = read_stack(parsed.tree)
    assert read is not None
    return read


def topics(text: str) -> set[str]:
    return {f"{end.direction} {end.topic}" for end in stack_endpoints(stack(text))}


@pytest.mark.parametrize(
    ("written", "absolute"),
    [
        ("/a", "/a"),
        ("a/b", "/left/a/b"),
        ("~/a", "/left/obelisk_control_0/a"),
        ("/old", "/new"),
        ("old", "/left/own"),
        ("/left/old", "/left/own"),
        ("/left/obelisk_control_0/state", "/state"),
        ("~/state", "/state"),
        ("twice", "/first"),
        ("/mine", "/new"),
        ("/others", "/others"),
        ("/typed", "/new"),
        ("/both", "/new"),
        ("/service", "/service"),
    ],
)
def test_topics_are_converted_to_absolute_names_as_in_ros(written: str, absolute: str) -> None:
    pairs = (
        "[/old:=/new, old:=own, ~/state:=/state, /left/twice:=/first, twice:=/second, "
        "obelisk_control_0:/mine:=/new, obelisk_control_1:/others:=/new, "
        "rostopic:///typed:=/new, obelisk_control_0:rostopic:///both:=/new, "
        "rosservice:///service:=/new]"
    )
    node = f"pkg: demo, executable: run, namespace: left, remappings: {pairs}"
    component = f"publishers: [{{key: p, topic: '{written}'}}]"
    assert topics(f"control: {{{node}, {component}}}") == {f"publishes {absolute}"}


@pytest.mark.parametrize(
    ("is_simulated", "published"),
    [("true", {"publishes /s"}), ("~", {"publishes /s"}), ("false", set())],
)
def test_sensor_groups_are_published_if_the_robot_is_simulated(
    is_simulated: str, published: set[str]
) -> None:
    group = "{topic: /s, dt: 0.1, msg_type: Imu}"
    sim = f"sim: {{model_xml_path: m.xml, sensor_settings: [{group}]}}"
    node = f"pkg: demo, executable: run, is_simulated: {is_simulated}, {sim}"
    assert topics(f"robot: {{{node}}}") == published


def test_a_joystick_publishes_and_listens() -> None:
    assert topics("joystick: {pub_topic: /joy, sub_topic: feedback}") == {
        "publishes /joy",
        "subscribes /feedback",
    }
    assert topics("joystick: {on: false, pub_topic: /joy}") == set()
    usual = {"publishes /joy", "subscribes /joy/set_feedback"}
    assert topics("joystick: {device_id: 1}") == usual
