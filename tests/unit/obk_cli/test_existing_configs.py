"""Configs that are valid for the reference compile: what is harmless is at most a warning."""

import json
from collections.abc import Mapping
from pathlib import Path

import pytest

from obelisk_spec.components import parse_component_setting
from obk_cli.compiler import Options, Outcome, compile_config
from obk_cli.plan.plan import Plan, Process

CONFIG = """\
config: d
control:
  - pkg: demo
    executable: c
    publishers:
      - {key: pub_ctrl, topic: /ctrl, msg_type: PositionSetpoint}
    subscribers:
      - {key: sub_est, topic: /estimate, msg_type: EstimatedState}
    timers:
      - {key: timer_ctrl, timer_period_sec: 0.01}
estimation:
  pkg: demo
  executable: e
  publishers: [{key: pub_est, topic: /estimate, msg_type: EstimatedState}]
  subscribers: [{key: sub_sensor, topic: /joint_encoders, msg_type: ObkJointEncoders}]
robot:
  pkg: demo
  executable: r
  publishers: [{key: pub_sensor, topic: /joint_encoders, msg_type: ObkJointEncoders}]
  subscribers: [{key: sub_ctrl, topic: /ctrl, msg_type: PositionSetpoint}]
"""


def compiled(folder: Path, text: str, files: Mapping[str, str] | None = None) -> Outcome:
    for name, content in {"c.yaml": text, **(files or {})}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content)
    options = Options(variables={}, working_folder=folder, ignore=("OBK401", "OBK402"))
    return compile_config(str(folder / "c.yaml"), options)


def found(outcome: Outcome) -> list[str]:
    return [f"{finding.severity} {finding.code}" for finding in outcome.diagnostics]


def process(outcome: Outcome, section: str) -> Process:
    assert isinstance(outcome.plan, Plan)
    (one,) = (process for process in outcome.plan.processes if process.section == section)
    return one


def setting(outcome: Outcome, section: str, parameter: str) -> Mapping[str, object]:
    return parse_component_setting(str(process(outcome, section).parameters[parameter]))


@pytest.mark.parametrize(
    ("right", "written", "findings"),
    [
        ("timer_period_sec: 0.01", "timer_period_sec: 0.01, history_depth: 10", ["info OBK506"]),
        ("robot:\n", "viz: {on: true, viz_tool: rviz}\nrobot:\n", ["info OBK506"]),
        ("/ctrl, msg", "/ctrl, callback_group: none, msg", ["info OBK507"]),
        ("0.01", "0.01, callback_group: NONE", ["info OBK507"]),
        ("topic: /est", "history_depth: 10.0, topic: /est", ["info OBK507"]),
        ("topic: /est", "history_depth: 9.0, topic: /est", []),
        ("topic: /est", "qos: {history_depth: 9.0}, topic: /est", []),
    ],
)
def test_what_does_no_harm_is_at_most_an_info(
    tmp_path: Path, right: str, written: str, findings: list[str]
) -> None:
    assert right in CONFIG
    outcome = compiled(tmp_path, CONFIG.replace(right, written, 1))
    assert found(outcome) == findings
    assert outcome.plan is not None


def test_what_has_no_effect_does_not_reach_the_node(tmp_path: Path) -> None:
    text = CONFIG.replace("0.01}", "0.01, history_depth: 10, callback_group: none}")
    assert setting(compiled(tmp_path, text), "control", "timer_ctrl_setting") == {
        "key": "timer_ctrl",
        "ros_parameter": "timer_ctrl_setting",
        "timer_period_sec": 0.01,
    }


def test_a_whole_history_depth_reaches_the_node_as_an_integer(tmp_path: Path) -> None:
    text = CONFIG.replace("topic: /est", "history_depth: 9.0, topic: /est", 1)
    depth = setting(compiled(tmp_path, text), "control", "sub_est_setting")["history_depth"]
    assert json.dumps(depth) == "9"


def test_of_two_components_with_one_key_the_first_is_used(tmp_path: Path) -> None:
    second = "\n      - {key: sub_est, topic: /unknown, msg_type: EstimatedState}"
    right = "{key: sub_est, topic: /estimate, msg_type: EstimatedState}"
    outcome = compiled(tmp_path, CONFIG.replace(right, right + second))
    assert found(outcome) == ["warning OBK108"]
    assert setting(outcome, "control", "sub_est_setting")["topic"] == "/estimate"
    assert "/unknown" not in process(outcome, "control").parameters["obelisk_settings"]


def test_an_empty_list_takes_the_place_of_the_included_one(tmp_path: Path) -> None:
    outer = "include: inner.yaml\ncontrol: {name: a, timers: []}\n"
    inner = CONFIG.replace("- pkg: demo", "- name: a\n    pkg: demo")
    kept = compiled(tmp_path, "include: inner.yaml\n", {"inner.yaml": inner})
    assert "timer_ctrl_setting" in process(kept, "control").parameters
    emptied = compiled(tmp_path, outer, {"inner.yaml": inner})
    assert found(emptied) == []
    assert "timer_ctrl_setting" not in process(emptied, "control").parameters
