from pathlib import Path

import pytest

from obk_cli.compiler import Options
from obk_cli.diagnostics.diagnostic import Diagnostic, found
from obk_cli.diagnostics.source import SourceFile, Span
from obk_cli.joining.entry_text import flow_text
from obk_cli.joining.join import Joined, join_node
from obk_cli.joining.newcomer import read_newcomer
from obk_cli.joining.proof import new_errors
from obk_cli.workspace.environment import MachineEnvironment
from obk_cli.workspace.package_index import PackageIndex

HERE = Path(__file__).parent
NEW = """\
- pkg: new_node
  executable: new_node
  publishers:
    - ros_parameter: pub_sensor_setting
      topic: /somewhere/imu
      msg_type: ObkImu
"""
SOUND = """\
config: a
control:
  - pkg: demo
    executable: controller
    publishers: [{key: pub_ctrl, topic: /a/ctrl, msg_type: PositionSetpoint}]
    subscribers: [{key: sub_est, topic: /a/est, msg_type: EstimatedState}]
estimation:
  - pkg: demo
    executable: estimator
    publishers: [{key: pub_est, topic: /a/est, msg_type: EstimatedState}]
    subscribers: [{key: sub_sensor, topic: /a/q, msg_type: ObkJointEncoders}]
robot:
  - pkg: demo
    executable: robot
    publishers: [{key: pub_q, topic: /a/q, msg_type: ObkJointEncoders}]
    subscribers: [{key: sub_ctrl, topic: /a/ctrl, msg_type: PositionSetpoint}]
sensing:
  - pkg: demo
    executable: camera"""


def join(text: str, section: str = "sensing", new: str = NEW) -> str:
    environment = MachineEnvironment(HERE, HERE, {})
    environment.packages = PackageIndex(workspaces=(), prefixes=())
    options = Options(variables={}, working_folder=HERE, ignore=("OBK4",), environment=environment)
    joined = join_node(SourceFile.of("c.yaml", text), read_newcomer(section, new), options)
    assert isinstance(joined, Joined), joined
    return joined.text


@pytest.mark.parametrize("line_end", ["\n", "\r\n", "\r"])
def test_line_ends_are_those_of_the_file_and_a_last_line_without_one_stays_so(
    line_end: str,
) -> None:
    before = SOUND.replace("\n", line_end)
    lines = (
        "  - pkg: new_node",
        "    executable: new_node",
        "    publishers:",
        "      - {key: pub_sensor, topic: /a/new_node/imu, msg_type: ObkImu}",
    )
    assert join(before) == before + "".join(f"{line_end}{line}" for line in lines)
    assert join(before + line_end) == join(before) + line_end


def test_a_topic_of_its_own_is_one_that_nobody_has() -> None:
    text = SOUND.replace("/a/q", "/a/new_node/imu")
    assert "topic: /a/new_node/new_node/imu" in join(text)


def test_a_topic_that_its_readers_want_kept_is_published_so() -> None:
    wanting = SOUND.replace(
        "{key: sub_sensor, topic: /a/q, msg_type: ObkJointEncoders}",
        "{key: sub_sensor, topic: /a/q, msg_type: ObkJointEncoders}, "
        "{key: sub_imu, topic: /a/imu, msg_type: ObkImu, qos: {durability: transient_local}}",
    )
    assert "topic: /a/imu, msg_type: ObkImu, qos: {durability: transient_local}}" in join(wanting)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.00001, "0.00001"),
        (1.0, "1.0"),
        (7, "7"),
        (True, "true"),
        (None, "null"),
        ("yes", "yes"),
        ("true", '"true"'),
        ("1.0", '"1.0"'),
        ("a # b", '"a # b"'),
        ("größe", '"größe"'),
        ("/${A}/b", '"/${A}/b"'),
        ([1, 2.5], "[1, 2.5]"),
        ({"a": {"b": "c"}}, "{a: {b: c}}"),
    ],
    ids=repr,
)
def test_a_value_is_written_as_what_it_is(value: object, text: str) -> None:
    assert flow_text(value) == text


@pytest.mark.parametrize("text", ["", "a", "[]", "- a", "- {}", "- pkg: a", "- {pkg: a}\n- {}"])
def test_what_is_no_entry_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="a new node "):
        read_newcomer("control", text)


def error(code: str, message: str, line: int) -> Diagnostic:
    return found(code, message, Span.at(SourceFile.of("c", "a\nb\nc"), line, 1))


def test_an_error_that_only_moved_or_changed_its_number_is_not_new() -> None:
    before = [error("OBK203", "nothing publishes `/x`, to which `/obelisk_control_1`", 1)]
    moved = [error("OBK203", "nothing publishes `/x`, to which `/obelisk_control_2`", 3)]
    assert new_errors(before, moved) == ()
    more = error("OBK203", "nothing publishes `/y`", 2)
    assert new_errors(before, [*before, more]) == (more,)
    assert new_errors([], [error("OBK204", "an info", 1)]) == ()
