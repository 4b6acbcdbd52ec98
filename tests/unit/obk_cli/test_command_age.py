"""`max_age_sec` and `stale_action` from the config to the robot, in either format."""

import pytest

from obelisk_spec.components import parse_component_setting, parse_mapping
from obk_cli.config.model import Stack
from obk_cli.config.reader import read_stack
from obk_cli.config.yaml_parser import parse_source
from obk_cli.configedit.migrate import migrate_source
from obk_cli.diagnostics.source import SourceFile
from obk_cli.emit.launch_file import emit_launch_file
from obk_cli.emit.params import emit_params
from obk_cli.plan.lower import lower_stack
from obk_cli.plan.plan import Plan

from .nowhere import Nowhere

OLDER = """\
config: arm
onboard:
  robot:
    - pkg: demo
      executable: robot
      subscribers:
        - ros_parameter: sub_ctrl_setting
          topic: /ctrl
          max_age_sec: 0.1  # ten periods
          stale_action: hold
"""
NEWER = """\
config: arm
robot:
  - pkg: demo
    executable: robot
    subscribers:
      - key: sub_ctrl
        topic: /ctrl
        max_age_sec: 0.1  # ten periods
        stale_action: hold
"""
SPELLINGS = pytest.mark.parametrize("text", [OLDER, NEWER], ids=["older", "newer"])


def read(text: str) -> Stack:
    parsed = parse_source(SourceFile.of("arm.yaml", text))
    assert parsed.tree is not None
    stack, faults = read_stack(parsed.tree)
    assert stack is not None
    assert not [fault for fault in faults if fault.severity == "error"]
    return stack


def lower(text: str) -> Plan:
    return lower_stack(read(text), Nowhere())


@SPELLINGS
def test_it_is_read_with_its_places(text: str) -> None:
    (component,) = read(text).nodes[0].components
    assert component.max_age_s is not None
    assert component.stale_action is not None
    assert (component.max_age_s.value, component.max_age_s.span.text) == (0.1, "0.1")
    assert component.stale_action.value == "hold"


@SPELLINGS
def test_the_robot_gets_it_with_its_subscriber_and_in_all_settings(text: str) -> None:
    (robot,) = lower(text).nodes
    own = parse_component_setting(str(robot.parameters["sub_ctrl_setting"]))
    (entry,) = parse_mapping(str(robot.parameters["obelisk_settings"]))["subscribers"]  # type: ignore[misc]
    assert (own["max_age_sec"], own["stale_action"]) == (0.1, "hold")
    assert {**own, "ros_parameter": "sub_ctrl_setting"} == entry


def test_both_formats_compile_to_the_same_plan() -> None:
    older, newer = (lower(text).nodes[0].parameters for text in (OLDER, NEWER))
    assert older == newer


def test_a_parameter_file_and_a_launch_file_hold_it() -> None:
    plan = lower(NEWER)
    setting = '"max_age_sec": 0.1, "stale_action": "hold"'
    assert setting in emit_params(plan.nodes)
    assert setting in emit_launch_file(plan)


def test_migrating_keeps_it() -> None:
    assert migrate_source(SourceFile.of("arm.yaml", OLDER), "key").text == NEWER
    assert migrate_source(SourceFile.of("arm.yaml", NEWER), "seed").text == OLDER
