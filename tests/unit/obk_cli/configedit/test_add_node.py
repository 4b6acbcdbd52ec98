import json
from pathlib import Path

import pytest
import yaml

from obk_cli.compiler import Options
from obk_cli.config.tree import plain_value
from obk_cli.config.yaml_parser import parse_source
from obk_cli.configedit.add_node import add_node, new_errors
from obk_cli.configedit.new_node import Rejected, read_new_node
from obk_cli.configedit.report import AddedNode
from obk_cli.diagnostics.diagnostic import Diagnostic, found
from obk_cli.diagnostics.source import SourceFile, Span
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
VALID_TEXT = """\
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


def add_to(text: str, section: str = "sensing", new: str = NEW) -> AddedNode | Rejected:
    environment = MachineEnvironment(HERE, HERE, {})
    environment.packages = PackageIndex(workspaces=(), prefixes=())
    options = Options(variables={}, working_folder=HERE, ignore=("OBK4",), environment=environment)
    return add_node(SourceFile.of("c.yaml", text), read_new_node(section, new), options)


def with_node(text: str, section: str = "sensing", new: str = NEW) -> str:
    added = add_to(text, section, new)
    assert isinstance(added, AddedNode), added
    return added.text


@pytest.mark.parametrize("line_end", ["\n", "\r\n", "\r"])
def test_line_ends_are_kept_and_so_is_a_last_line_without_one(
    line_end: str,
) -> None:
    before = VALID_TEXT.replace("\n", line_end)
    lines = (
        "  - pkg: new_node",
        "    executable: new_node",
        "    publishers:",
        "      - key: pub_sensor",
        "        topic: /a/new_node/imu",
        "        msg_type: ObkImu",
    )
    assert with_node(before) == before + "".join(f"{line_end}{line}" for line in lines)
    assert with_node(before + line_end) == with_node(before) + line_end


def test_a_new_topic_is_an_unused_one() -> None:
    text = VALID_TEXT.replace("/a/q", "/a/new_node/imu")
    assert "topic: /a/new_node/new_node/imu" in with_node(text)


def test_a_topic_that_its_readers_want_kept_is_published_so() -> None:
    wanting = VALID_TEXT.replace(
        "{key: sub_sensor, topic: /a/q, msg_type: ObkJointEncoders}",
        "{key: sub_sensor, topic: /a/q, msg_type: ObkJointEncoders}, "
        "{key: sub_imu, topic: /a/imu, msg_type: ObkImu, qos: {durability: transient_local}}",
    )
    (new,) = yaml.safe_load(with_node(wanting))["sensing"][1:]
    assert new["publishers"][0]["topic"] == "/a/imu"
    assert new["publishers"][0]["qos"] == {"durability": "transient_local"}


FLOW = {
    "the whole config": "{config: a, sensing: [{pkg: demo, executable: camera}]}",
    "the list": "config: a\nsensing: [{pkg: demo, executable: camera}]\n",
    "the node": "config: a\nsensing: {pkg: demo, executable: camera}\n",
    "the device": "config: a\nonboard: {sensing: [{pkg: demo, executable: camera}]}\n",
    "an anchor": "config: a\nsensing: &s\n  pkg: demo\n  executable: camera\n",
}


VALUES = [
    *(0.00001, 1.0, 7, True, None, [1, 2.5], [], {}, {"a": {"b": "c"}}),
    *("yes", "true", "1.0", "a # b", "größe", "/${A}/b", "a: b", "- a", "it's", '"'),
]


@pytest.mark.parametrize("value", VALUES, ids=repr)
def test_a_value_is_written_by_its_type(value: object) -> None:
    new = json.dumps([{"pkg": "new_node", "executable": "new_node", "params": {"a": value}}])
    rejected = add_to(FLOW["the list"], new=new)
    assert isinstance(rejected, Rejected)
    tree = parse_source(SourceFile.of("snippet", rejected.snippet)).tree
    assert tree is not None
    assert plain_value(tree) == json.loads(new)


@pytest.mark.parametrize("what", FLOW)
def test_a_section_that_is_not_in_block_style_is_rejected_with_a_snippet(what: str) -> None:
    rejected = add_to(FLOW[what])
    assert isinstance(rejected, Rejected)
    assert "c.yaml:" in rejected.sentence
    (pasted,) = yaml.safe_load(rejected.snippet)
    assert (pasted["pkg"], pasted["publishers"][0]["key"]) == ("new_node", "pub_sensor")


@pytest.mark.parametrize("text", ["", "a", "[]", "- a", "- {}", "- pkg: a", "- {pkg: a}\n- {}"])
def test_what_is_no_entry_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="expected "):
        read_new_node("control", text)


def error(code: str, message: str, line: int) -> Diagnostic:
    return found(code, message, Span.at(SourceFile.of("c", "a\nb\nc"), line, 1))


def test_an_error_that_only_moved_or_changed_its_number_is_not_new() -> None:
    before = [error("OBK203", "nothing publishes `/x`, to which `/obelisk_control_1`", 1)]
    moved = [error("OBK203", "nothing publishes `/x`, to which `/obelisk_control_2`", 3)]
    assert new_errors(before, moved) == ()
    more = error("OBK203", "nothing publishes `/y`", 2)
    assert new_errors(before, [*before, more]) == (more,)
    assert new_errors([], [error("OBK204", "an info", 1)]) == ()
