"""Configs that compile in the reference implementation have at most warnings."""

import json
import re
from collections.abc import Mapping
from pathlib import Path

import pytest

from obelisk_spec.components import parse_component_setting
from obk_cli.cli.main import main
from obk_cli.compiler import Options, Outcome, compile_config
from obk_cli.plan.plan import Plan, PlannedNode
from obk_cli.workspace.config_files import configs_that_include

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


def process(outcome: Outcome, section: str) -> PlannedNode:
    assert isinstance(outcome.plan, Plan)
    (one,) = (process for process in outcome.plan.nodes if process.section == section)
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
def test_harmless_findings_are_at_most_infos(
    tmp_path: Path, right: str, written: str, findings: list[str]
) -> None:
    assert right in CONFIG
    outcome = compiled(tmp_path, CONFIG.replace(right, written, 1))
    assert found(outcome) == findings
    assert outcome.plan is not None


def test_settings_without_effect_do_not_reach_the_node(tmp_path: Path) -> None:
    text = CONFIG.replace("0.01}", "0.01, history_depth: 10, callback_group: none}")
    assert setting(compiled(tmp_path, text), "control", "timer_ctrl_setting") == {
        "key": "timer_ctrl",
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


def test_an_empty_list_replaces_the_included_one(tmp_path: Path) -> None:
    outer = "include: inner.yaml\ncontrol: {name: a, timers: []}\n"
    inner = CONFIG.replace("- pkg: demo", "- name: a\n    pkg: demo")
    kept = compiled(tmp_path, "include: inner.yaml\n", {"inner.yaml": inner})
    assert "timer_ctrl_setting" in process(kept, "control").parameters
    emptied = compiled(tmp_path, outer, {"inner.yaml": inner})
    assert found(emptied) == []
    assert "timer_ctrl_setting" not in process(emptied, "control").parameters


@pytest.mark.parametrize("section", ["control", "estimation", "robot"])
def test_a_stack_may_lack_a_section(tmp_path: Path, section: str) -> None:
    outcome = compiled(tmp_path, CONFIG.replace(f"{section}:\n", "sensing:\n"))
    assert "info OBK201" in found(outcome)
    assert outcome.diagnostics[0].message == f"the stack has no node in `{section}`"


OUTSIDE = CONFIG.replace(
    "subscribers: [{key: sub_sensor, ",
    "subscribers: [{key: sub_map, topic: /map, msg_type: nav_msgs/OccupancyGrid}, "
    "{key: sub_pose, topic: /mocap/pose, msg_type: PoseStamped}, {key: sub_sensor, ",
)


def test_topics_from_outside_are_one_warning(tmp_path: Path) -> None:
    outcome = compiled(tmp_path, OUTSIDE)
    (finding,) = outcome.diagnostics
    assert (finding.code, finding.severity) == ("OBK203", "warning")
    assert "`external_topics: [/map, /mocap/pose]`" in (finding.help or "")
    assert outcome.plan is not None
    listed = compiled(tmp_path, OUTSIDE + "external_topics: [/map, /mocap/pose]\n")
    assert found(listed) == []
    assert listed.plan is not None
    assert listed.plan.external_topics == ("/map", "/mocap/pose")


def test_external_topics_of_an_included_file_are_merged_by_name(tmp_path: Path) -> None:
    inner = OUTSIDE + "external_topics: {/map: , /mocap/pose: {direction: subscribed}}\n"
    outer = "include: inner.yaml\nexternal_topics: {/mocap/pose: {direction: published}}\n"
    assert found(compiled(tmp_path, inner)) == ["warning OBK203"]
    assert found(compiled(tmp_path, outer, {"inner.yaml": inner})) == []


def test_a_topic_with_an_outside_subscriber_is_no_loose_end(tmp_path: Path) -> None:
    unread = CONFIG.replace(
        "publishers: [{key: pub_est,",
        "publishers: [{key: pub_path, topic: /path, msg_type: nav_msgs/Path}, {key: pub_est,",
    )
    assert found(compiled(tmp_path, unread)) == ["info OBK204"]
    known = "external_topics: {/path: {direction: subscribed}}\n"
    assert found(compiled(tmp_path, unread + known)) == []


def test_a_loop_may_be_closed_outside(tmp_path: Path) -> None:
    text = CONFIG.replace("key: sub_sensor, topic: /joint_encoders", "key: sub_sensor, topic: /x")
    text = text.replace("ObkJointEncoders}]\nrobot", "PoseStamped}]\nrobot")
    assert "external_topics: [/x]" not in text
    assert found(compiled(tmp_path, text + "external_topics: [/x]\n")) == ["info OBK204"]


FRAGMENT = CONFIG[: CONFIG.index("robot:\n")] + "robot: {name: arm, respawn: true}\n"


def test_a_fragment_is_checked_for_its_content(tmp_path: Path) -> None:
    (tmp_path / "src").mkdir()
    alone = compiled(tmp_path, FRAGMENT)
    assert "error OBK102" in found(alone)
    rest = "robot: {name: arm, pkg: demo, executable: r}\n"
    (tmp_path / "stack.yaml").write_text(f"include: c.yaml\n{rest}")
    options = Options(
        variables={},
        working_folder=tmp_path,
        ignore=("OBK401", "OBK402"),
        including=configs_that_include,
    )
    fragment = compile_config(str(tmp_path / "c.yaml"), options)
    assert found(fragment) == ["info OBK016"]
    assert fragment.plan is None
    (tmp_path / "c.yaml").write_text(FRAGMENT.replace("executable: c", "excutable: c"))
    faulty = compile_config(str(tmp_path / "c.yaml"), options)
    assert found(faulty) == ["info OBK016", "error OBK101"]


def test_the_external_topics_of_the_document_are_those_of_the_warning(
    tmp_path: Path, repository: Path
) -> None:
    document = (repository / "docs/how-to/from-ros.md").read_text()
    listings = re.findall(r"```yaml\n(external_topics:.*?)```", document, re.DOTALL)
    assert len(listings) == 2
    for listing in listings:
        assert found(compiled(tmp_path, OUTSIDE + listing)) == []


@pytest.mark.parametrize("spelling", ["key", "seed"])
def test_migrate_keeps_external_topics(tmp_path: Path, spelling: str) -> None:
    path = tmp_path / "c.yaml"
    topics = "external_topics:\n  /map: {direction: published}  # the map server\n"
    path.write_text(CONFIG + topics)
    with pytest.raises(SystemExit) as ended:
        main(["migrate", str(path), "--to", spelling, "--write"])
    assert ended.value.code == 0
    assert topics in path.read_text()


SIM = CONFIG[: CONFIG.index("  executable: r\n")] + (
    "  executable: hardware\n"
    "  is_simulated: false\n"
    "  publishers: [{key: pub_sensor, topic: /joint_encoders, msg_type: ObkJointEncoders}]\n"
    "  subscribers: [{key: sub_ctrl, topic: /ctrl, msg_type: PositionSetpoint}]\n"
    "  sim: {model_xml_path: /home/ada/no.xml, num_steps_per_viz: 0, sensor_setings: 1}\n"
)


def test_a_sim_block_that_is_not_used_is_reported_once(tmp_path: Path) -> None:
    outcome = compiled(tmp_path, SIM)
    assert found(outcome) == ["info OBK506"]
    assert outcome.plan is not None
    used = found(compiled(tmp_path, SIM.replace("is_simulated: false", "is_simulated: true")))
    assert {"error OBK101", "error OBK104"} <= set(used)


PACKAGE = "<package><name>{0}</name></package>"
SIMULATOR = (
    "import sys\n"
    "from obelisk_py.core.sim.mujoco import ObeliskMujocoRobot\n"
    "from obelisk_py.core.utils.ros import spin_obelisk\n"
    "def main():\n    spin_obelisk(sys.argv, ObeliskMujocoRobot)\n"
)


def workspace(folder: Path) -> Mapping[str, str]:
    """The files of a workspace: a simulator in Python, a package in C++, a share folder."""
    (folder / "src").mkdir(exist_ok=True)
    return {
        "src/sim/package.xml": PACKAGE.format("sim"),
        "src/sim/setup.py": "from setuptools import setup\nsetup(entry_points={'console_scripts':"
        " ['obelisk_mujoco_robot = sim.main:main']})\n",
        "src/sim/sim/main.py": SIMULATOR,
        "src/sim/sim/__init__.py": "",
        "src/cpp/package.xml": PACKAGE.format("cpp"),
        "src/cpp/CMakeLists.txt": "project(cpp)\n# add_executable(old old.cpp)\n"
        "add_executable(est est.cpp)\nadd_executable(${PROJECT_NAME}_node node.cpp)\n",
        "src/cpp/scripts/script": "#!/usr/bin/env python3\n",
        "src/shared/package.xml": PACKAGE.format("shared"),
        "src/shared/gains/ctrl.yaml": "kp: 1\n",
    }


def compiled_here(folder: Path, text: str) -> Outcome:
    for name, content in {"c.yaml": text, **workspace(folder)}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content)
    options = Options(variables={}, working_folder=folder, ignore=("OBK401",))
    return compile_config(str(folder / "c.yaml"), options)


SIMULATED = CONFIG.replace(
    "  pkg: demo\n  executable: r\n",
    "  pkg: sim\n  executable: obelisk_mujoco_robot\n  is_simulated: true\n"
    "  sim: {model_xml_path: m.xml, sensor_settings: [{topic: /joint_encoders, dt: 0.01, "
    "msg_type: ObkJointEncoders, sensor_names: {angle: jointpos}}]}\n",
)
MODEL = (
    '<mujoco><worldbody><body><joint name="j" type="hinge"/><geom size="1"/></body></worldbody>'
    '<actuator><motor joint="j"/></actuator>'
    '<sensor><jointpos name="angle" joint="j"/></sensor></mujoco>'
)


@pytest.mark.mujoco
def test_a_simulator_ignores_hardware_settings(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text(MODEL)
    outcome = compiled_here(tmp_path, SIMULATED)
    assert found(outcome) == ["info OBK406"]
    (topic,) = process(outcome, "robot").publishes
    assert topic.topic == "/joint_encoders"
    misspelt = compiled_here(tmp_path, SIMULATED.replace("key: sub_ctrl", "key: sub_ctlr"))
    assert "error OBK406" in found(misspelt)


@pytest.mark.mujoco
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("key: sub_ctrl", "key: sub_control"),
        ("]\n  subscribers: [{key: sub_ctrl", ", {key: sub_ctrl"),
    ],
)
def test_the_misspelled_control_input_of_a_simulator_is_one_error(
    tmp_path: Path, old: str, new: str
) -> None:
    (tmp_path / "m.xml").write_text(MODEL)
    text = SIMULATED.replace(old, new)
    assert text != SIMULATED
    errors = [f for f in compiled_here(tmp_path, text).diagnostics if f.severity == "error"]
    assert [(f.code, f.span.text) for f in errors] == [("OBK406", new.rpartition(" ")[2])]


@pytest.mark.mujoco
def test_the_hardware_s_components_of_a_simulator_are_one_finding(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text(MODEL)
    own = "{key: pub_imu, topic: /joint_encoders, msg_type: ObkJointEncoders}"
    timers = "\n  timers: [{ros_parameter: timer_sensor_setting, timer_period_sec: 0.01}]"
    text = SIMULATED.replace(
        "]\n  subscribers: [{key: sub_ctrl", f", {own}]{timers}\n  subscribers: [{{key: sub_ctrl"
    )
    assert text.count("pub_imu") == text.count("timer_sensor") == 1
    assert found(compiled_here(tmp_path, text)) == ["info OBK406"]


@pytest.mark.mujoco
@pytest.mark.parametrize(("name", "value"), [("num_steps_per_viz", 5), ("n_u", 1)])
def test_whole_numbers_may_have_a_decimal_point(tmp_path: Path, name: str, value: int) -> None:
    (tmp_path / "m.xml").write_text(MODEL)
    text = SIMULATED.replace("m.xml,", f"m.xml, {name}: {value}.0,")
    outcome = compiled_here(tmp_path, text)
    assert found(outcome) == ["info OBK406"]
    block = json.loads(str(process(outcome, "robot").parameters["mujoco_setting"]))
    assert block[name] == value
    assert isinstance(block[name], int)
    half = compiled_here(tmp_path, text.replace(".0,", ".5,"))
    assert "error OBK103" in found(half)


@pytest.mark.mujoco
def test_both_names_of_a_key_with_equal_values_are_no_error(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text(MODEL)
    head, tail = SIMULATED.split("dt: 0.01, msg")
    both = compiled_here(tmp_path, f"{head}dt: 0.01, sensor_type: ObkJointEncoders, msg{tail}")
    assert sorted(found(both)) == ["info OBK406", "info OBK506"]
    assert "sensor_type" not in str(process(both, "robot").parameters["mujoco_setting"])
    differ = compiled_here(tmp_path, f"{head}dt: 0.01, sensor_type: ObkImu, msg{tail}")
    assert "error OBK101" in found(differ)


@pytest.mark.mujoco
@pytest.mark.parametrize(
    ("params", "findings"),
    [
        ("ic_keyframes: home", ["warning OBK409"]),
        ("camera_of_mine: 1", []),
        ("ic_keyframe: '', ic_keyframes: home", []),
    ],
)
def test_a_misspelled_parameter_of_the_simulator_is_found(
    tmp_path: Path, params: str, findings: list[str]
) -> None:
    """The simulator computes names of parameters, so another name may be one of them."""
    (tmp_path / "m.xml").write_text(MODEL)
    text = SIMULATED.replace(
        "  is_simulated: true\n", f"  is_simulated: true\n  params: {{{params}}}\n"
    )
    codes = found(compiled_here(tmp_path, text))
    assert [one for one in codes if "OBK409" in one] == findings


def test_two_robots_of_two_files_are_one_finding(tmp_path: Path) -> None:
    """An entry without a name is appended to the included list."""
    imu = "{key: pub_imu, topic: /imu, msg_type: Imu}"
    base = CONFIG.replace(
        "ObkJointEncoders}]\n  subscribers: [{key: sub_c",
        f"ObkJointEncoders}}, {imu}]\n  subscribers: [{{key: sub_c",
    )
    robot = base[base.index("robot:\n") :].replace("  pkg", "  - pkg").replace("\n  ", "\n    ")
    robot = robot.replace("    - pkg", "  - pkg")
    listed = base[: base.index("robot:\n")] + robot
    twin = f"include: [base.yaml]\n{robot}"
    outcome = compiled(tmp_path, twin, {"base.yaml": listed})
    (finding,) = (one for one in outcome.diagnostics if one.code == "OBK218")
    assert "`/joint_encoders`, `/imu`" in finding.message
    assert "`name`" in (finding.help or "")
    named = listed.replace(
        "- pkg: demo\n    executable: r", "- pkg: demo\n    name: a\n    executable: r"
    )
    same = twin.replace(
        "- pkg: demo\n    executable: r", "- pkg: demo\n    name: a\n    executable: r"
    )
    assert "warning OBK218" not in found(compiled(tmp_path, same, {"base.yaml": named}))


def test_a_missing_file_in_a_home_is_one_finding(tmp_path: Path) -> None:
    text = CONFIG.replace("executable: e\n", "executable: e\n  params_path: /home/ada/no.txt\n")
    assert found(compiled(tmp_path, text)) == ["warning OBK404"]


SLOW = "  timers: [{key: timer_est, timer_period_sec: 0.002}]\nrobot:\n"


@pytest.mark.mujoco
def test_a_long_sensor_period_is_found_next_to_slow_sensors(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text(MODEL)
    slow = "{topic: /slow, dt: 1.0, msg_type: ObkJointEncoders, sensor_names: {angle: jointpos}}"
    text = SIMULATED.replace("sensor_settings: [", f"sensor_settings: [{slow}, ")
    text = text.replace("0.01", "0.002").replace("robot:\n", SLOW)
    wrong = text.replace("dt: 0.002", "dt: 2")
    assert [one for one in found(compiled_here(tmp_path, text)) if "OBK2" in one] == ["info OBK204"]
    assert [one for one in found(compiled_here(tmp_path, wrong)) if "OBK2" in one] == [
        "info OBK204",
        "warning OBK220",
    ]


@pytest.mark.parametrize("slow", ["0.05", "1.0"])
def test_a_long_period_is_found_next_to_slow_timers_of_the_user(tmp_path: Path, slow: str) -> None:
    text = CONFIG.replace("0.01", "0.002").replace("robot:\n", SLOW)
    text += f"  timers: [{{key: timer_log, timer_period_sec: {slow}}}]\n"
    assert found(compiled(tmp_path, text)) == []
    head, tail = text.split("timer_est, timer_period_sec: 0.002")
    wrong = f"{head}timer_est, timer_period_sec: 2{tail}"
    assert [f for f in found(compiled(tmp_path, wrong)) if "22" in f or "211" in f] == [
        "warning OBK220"
    ]


def test_a_cpp_node_ignores_the_type(tmp_path: Path) -> None:
    cpp = CONFIG.replace("pkg: demo\n  executable: e", "pkg: cpp\n  executable: est")
    stale = cpp.replace("/joint_encoders, msg_type: Obk", "/joint_encoders, msg_type: ", 1)
    unknown = cpp.replace("/joint_encoders, msg_type: Obk", "/joint_encoders, msg_type: My", 1)
    other = cpp.replace("msg_type: ObkJointEncoders", "msg_type: ObkImu", 1)
    not_built = "error OBK402"
    assert found(compiled_here(tmp_path, cpp)) == [not_built]
    assert found(compiled_here(tmp_path, stale)) == [not_built]
    assert found(compiled_here(tmp_path, unknown)) == [not_built, "info OBK115"]
    assert found(compiled_here(tmp_path, other)) == [not_built, "warning OBK205"]
    in_python = unknown.replace("pkg: cpp", "pkg: demo")
    assert "error OBK115" in found(compiled_here(tmp_path, in_python))


@pytest.mark.parametrize("prefix", ["install", "install/cpp"])
def test_an_executable_that_is_not_sourced_has_its_command(tmp_path: Path, prefix: str) -> None:
    program = tmp_path / prefix / "lib/cpp/est"
    program.parent.mkdir(parents=True)
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    text = CONFIG.replace("pkg: demo\n  executable: e", "pkg: cpp\n  executable: est")
    (finding,) = compiled_here(tmp_path, text).diagnostics
    assert finding.code == "OBK402"
    assert finding.help is not None
    assert f"source {tmp_path}/install/setup.bash" in finding.help


@pytest.mark.parametrize(
    ("executable", "help"),
    [
        ("est", "run `colcon build --packages-select cpp` and source `install/setup.bash`"),
        ("cpp_node", "run `colcon build --packages-select cpp` and source `install/setup.bash`"),
        ("script", "run `chmod +x {}/src/cpp/scripts/script`"),
    ],
)
def test_an_executable_that_is_not_ready_has_its_command(
    tmp_path: Path, executable: str, help: str
) -> None:
    text = CONFIG.replace("pkg: demo\n  executable: e", f"pkg: cpp\n  executable: {executable}")
    (fault,) = compiled_here(tmp_path, text).diagnostics
    assert (fault.code, fault.help) == ("OBK402", help.format(tmp_path))
    (tmp_path / "src/cpp/scripts/script").chmod(0o755)


def test_a_declaration_in_a_comment_is_no_executable(tmp_path: Path) -> None:
    text = CONFIG.replace("pkg: demo\n  executable: e", "pkg: cpp\n  executable: old")
    (fault,) = compiled_here(tmp_path, text).diagnostics
    assert fault.code == "OBK402"
    assert "colcon" not in (fault.help or "")


def test_params_path_is_found_in_the_package_that_params_names(tmp_path: Path) -> None:
    text = CONFIG.replace(
        "executable: c\n",
        "executable: c\n    params_path: gains/ctrl.yaml\n    params: {params_path_pkg: shared}\n",
    )
    outcome = compiled_here(tmp_path, text)
    assert found(outcome) == []
    expected = str(tmp_path / "src/shared/gains/ctrl.yaml")
    assert process(outcome, "control").parameters["params_path"] == expected
    assert "warning OBK404" in found(compiled_here(tmp_path, text.replace("ctrl.y", "no.y")))
