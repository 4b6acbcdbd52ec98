from pathlib import Path

from obelisk_spec.components import parse_component_setting, parse_mapping
from obk_cli.compiler import Options, compile_source
from obk_cli.config.locate import locate_files
from obk_cli.config.model import FileSearch, Spanned
from obk_cli.config.reader import read_stack
from obk_cli.config.yaml_parser import parse_source
from obk_cli.diagnostics.source import SourceFile
from obk_cli.plan.lower import lower_stack
from obk_cli.plan.plan import Endpoint, Plan, PlannedSensorGroup

from ..nowhere import Nowhere  # noqa: TID252 - shared by folders of tests

CONFIG = """\
config: arm
robot:
  pkg: demo
  executable: sim
  namespace: left
  log_level: debug
  remappings: {/state: /arm/state}
  env: {A: 1}
  params_path: gains.txt
  params: {ic_keyframe: home, gains: [1, 2.5]}
  callback_groups: {fast: ReentrantCallbackGroup}
  publishers:
    - {key: pub_true_sim_state, topic: state}
  timers:
    - {ros_parameter: timer_true_sim_state_setting, timer_period_sec: 0.01, callback_group: fast}
  sim:
    model_xml_path: arm.xml
    robot_pkg: None
    sensor_settings:
      - {topic: /q, dt: 0.002, msg_type: JointEncoders, sensor_names: {a: jointpos}}
control:
  - pkg: demo
    executable: ctrl
    subscribers:
      - {ros_parameter: sub_q_setting, topic: /q, msg_type: JointEncoders, callback_group: None,
         non_obelisk: true, history_depth: 5}
joystick:
  pub_topic: /joy
  device_id: 1
"""


def lower_text(text: str) -> Plan:
    parsed = parse_source(SourceFile.of("arm.yaml", text))
    assert parsed.tree is not None
    stack, _ = read_stack(parsed.tree)
    assert stack is not None
    return lower_stack(stack, Nowhere())


def lower(folder: Path) -> Plan:
    parsed = parse_source(SourceFile.of("arm.yaml", CONFIG))
    assert parsed.tree is not None
    stack, faults = read_stack(parsed.tree)
    assert stack is not None
    assert {fault.severity for fault in faults} == {"info"}
    return lower_stack(locate_files(stack, folder, Nowhere()), Nowhere())


def test_a_node_becomes_a_process(tmp_path: Path) -> None:
    robot, control, joystick = lower(tmp_path).nodes
    assert robot.full_name == "/left/obelisk_robot_0"
    assert (robot.package, robot.executable, robot.log_level) == ("demo", "sim", "debug")
    assert robot.remappings == (("/state", "/arm/state"),)
    assert robot.env == {"A": "1"}
    assert str(robot.origin) == "arm.yaml:3:3"
    assert control.full_name == "/obelisk_control_0"
    assert joystick.remappings == (("joy", "/joy"),)
    assert joystick.parameters == {"device_id": 1}


def test_the_plan_starts_the_robot_first(tmp_path: Path) -> None:
    tiers = lower(tmp_path).tiers
    assert [[p.section for p in tier] for tier in tiers] == [["robot"], ["control"], ["joystick"]]


def test_a_component_is_emitted_under_its_parameter_and_in_the_settings(tmp_path: Path) -> None:
    _, control, _ = lower(tmp_path).nodes
    own = control.parameters["sub_q_setting"]
    assert own == "key:sub_q,topic:/q,msg_type:JointEncoders,history_depth:5"
    entry = {**parse_component_setting(str(own)), "ros_parameter": "sub_q_setting"}
    assert parse_mapping(str(control.parameters["obelisk_settings"])) == {"subscribers": [entry]}


def test_settings_that_flat_text_cannot_hold_are_flow_text() -> None:
    ends = "{key: sub_q, topic: /q, qos: {reliability: best_effort}}"
    text = f"robot:\n  pkg: a\n  executable: b\n  subscribers: [{ends}]\n"
    (process,) = lower_text(text).nodes
    assert parse_mapping(str(process.parameters["sub_q_setting"])) == {
        "key": "sub_q",
        "topic": "/q",
        "history_depth": 10,
        "qos": {"reliability": "best_effort"},
    }


def test_a_whole_depth_is_written_without_a_fraction() -> None:
    ends = "{key: sub_q, topic: /q, history_depth: 10.0}"
    text = f"robot:\n  pkg: a\n  executable: b\n  subscribers: [{ends}]\n"
    (process,) = lower_text(text).nodes
    assert process.parameters["sub_q_setting"] == "key:sub_q,topic:/q,history_depth:10"


def test_callback_groups_have_their_own_parameter(tmp_path: Path) -> None:
    robot, control, _ = lower(tmp_path).nodes
    assert robot.parameters["callback_group_settings"] == "fast:ReentrantCallbackGroup"
    assert "callback_group_settings" not in control.parameters


def test_a_component_with_only_a_key_gets_its_parameter_and_defaults(tmp_path: Path) -> None:
    robot, *_ = lower(tmp_path).nodes
    setting = {
        "key": "pub_true_sim_state",
        "ros_parameter": "pub_true_sim_state_setting",
        "topic": "state",
        "history_depth": 10,
    }
    settings = parse_mapping(str(robot.parameters["obelisk_settings"]))
    assert settings["publishers"] == [setting]
    assert settings["callback_groups"] == {"fast": "ReentrantCallbackGroup"}
    own = parse_component_setting(str(robot.parameters["pub_true_sim_state_setting"]))
    assert {**own, "ros_parameter": "pub_true_sim_state_setting"} == setting


def test_components_that_share_a_key_have_no_own_parameter() -> None:
    ends = [f"{{key: state, topic: /{topic}}}" for topic in ("in", "out")]
    text = f"subscribers: [{ends[0]}]\n  publishers: [{ends[1]}]"
    (process,) = lower_text(f"robot:\n  pkg: a\n  executable: b\n  {text}\n").nodes
    assert set(process.parameters) == {"obelisk_settings"}


def test_timers_and_sensor_groups_are_expected_rates_with_the_locations_of_their_periods(
    tmp_path: Path,
) -> None:
    (tmp_path / "arm.xml").touch()
    robot, control, _ = lower(tmp_path).nodes
    assert [(p.name, p.period_s, str(p.origin)) for p in robot.rates] == [
        ("timer_true_sim_state", 0.01, "arm.yaml:15:71"),
        ("/q", 0.002, "arm.yaml:20:25"),
    ]
    assert control.rates == ()


def test_a_simulator_reports_the_values_from_its_model(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").touch()
    robot, control, joystick = lower(tmp_path).nodes
    assert robot.model == str(tmp_path / "arm.xml")
    assert robot.sensor_groups == (
        PlannedSensorGroup(topic="/q", kind="JointEncoders", sensors={"a": "jointpos"}),
    )
    assert (control.model, control.sensor_groups) == (None, ())
    assert [p.has_lifecycle for p in (robot, control, joystick)] == [True, True, False]


def test_a_real_robot_reads_no_model() -> None:
    (process,) = lower_text(
        "robot:\n  pkg: a\n  executable: b\n  is_simulated: false\n"
        "  sim: {model_xml_path: x.xml, sensor_settings: "
        "[{topic: /q, dt: 0.1, msg_type: Imu, sensor_names: {a: gyro}}]}\n"
    ).nodes
    assert (process.model, process.sensor_groups) == (None, ())


def test_user_parameters_are_dotted_and_lists_of_one_type(tmp_path: Path) -> None:
    robot, *_ = lower(tmp_path).nodes
    assert robot.parameters["ic_keyframe"] == "home"
    assert robot.parameters["gains"] == (1.0, 2.5)


def test_existing_files_get_their_full_path(tmp_path: Path) -> None:
    robot, *_ = lower(tmp_path).nodes
    assert robot.parameters["params_path"] == "gains.txt"
    for name in ("arm.xml", "gains.txt"):
        (tmp_path / name).touch()
    robot, *_ = lower(tmp_path).nodes
    assert robot.parameters["params_path"] == str(tmp_path / "gains.txt")
    block = parse_mapping(str(robot.parameters["mujoco_setting"]))
    assert block["model_xml_path"] == str(tmp_path / "arm.xml")
    assert "robot_pkg" not in block


def test_ends_have_types_and_rates(tmp_path: Path) -> None:
    robot, control, joystick = lower(tmp_path).nodes
    assert robot.publishes == (
        Endpoint(
            topic="/left/state", msg_type="obelisk_sensor_msgs/msg/TrueSimState", rate_hz=100.0
        ),
        Endpoint(topic="/q", msg_type="obelisk_sensor_msgs/msg/JointEncoders", rate_hz=500.0),
    )
    assert control.subscribes == (
        Endpoint(topic="/q", msg_type="obelisk_sensor_msgs/msg/JointEncoders"),
    )
    assert [end.topic for end in joystick.publishes] == ["/joy"]


def test_searched_paths_are_kept(tmp_path: Path) -> None:
    parsed = parse_source(SourceFile.of("arm.yaml", CONFIG))
    assert parsed.tree is not None
    stack, _ = read_stack(parsed.tree)
    assert stack is not None
    search = locate_files(stack, tmp_path, Nowhere()).nodes[0].sims[0].model
    assert isinstance(search, FileSearch)
    assert isinstance(search.written, Spanned)
    assert search.tried[0] == tmp_path / "arm.xml"


def test_each_joystick_has_its_own_topics() -> None:
    plan = lower_text(
        "a: {joystick: {pub_topic: /a}}\nb: {joystick: {pub_topic: /b, sub_topic: /c}}\n"
    )
    assert [[end.topic for end in p.publishes] for p in plan.nodes] == [["/a"], ["/b"]]
    received = [[end.topic for end in p.subscribes] for p in plan.nodes]
    assert received == [["/joy/set_feedback"], ["/c"]]


def test_environment_variables_get_the_values_of_variables() -> None:
    options = Options(variables={"DOMAIN": "007"}, working_folder=Path.cwd())
    env = "env:\n    A: ${DOMAIN}\n    B: ${NONE:-1.10}\n    C: ${NO:-true}\n"
    text = f"robot:\n  pkg: a\n  executable: b\n  {env}"
    outcome = compile_source(SourceFile.of("<text>", text), options)
    assert outcome.config is not None
    (process,) = lower_stack(outcome.config, outcome.environment).nodes
    assert process.env == {"A": "007", "B": "1.10", "C": "true"}


def test_an_invalid_pattern_is_left_to_the_checks() -> None:
    group = "{topic: /s, dt: 0.1, msg_type: Unknown, scan_config: {pattern: lidar}}"
    sim = f"sim: {{model_xml_path: m.xml, sensor_settings: [{group}]}}"
    (robot,) = lower_text(f"robot: {{pkg: a, executable: b, {sim}}}").nodes
    assert [group.rays for group in robot.sensor_groups] == [None]


SIMULATED = """\
config: arm
robot:
  - {pkg: obelisk_sim_py, executable: obelisk_mujoco_robot, sim: {model_xml_path: arm.xml}}
control:
  - {pkg: demo, executable: ctrl}
joystick: {device_id: 1}
"""


def times(text: str) -> list[object]:
    return [process.parameters.get("use_sim_time") for process in lower_text(text).nodes]


def test_all_nodes_of_a_simulated_stack_use_simulated_time() -> None:
    assert times(SIMULATED) == [True, True, True]


def test_the_config_decides_which_time_is_used() -> None:
    assert times(f"{SIMULATED}obk: {{use_sim_time: false}}\n") == [None, None, None]
    assert times(f"{CONFIG}obk: {{use_sim_time: true}}\n") == [True, True, True]


def test_a_nodes_own_parameter_decides_for_that_node() -> None:
    own = "executable: ctrl, params: {use_sim_time: false}"
    assert times(SIMULATED.replace("executable: ctrl", own)) == [True, False, True]


def test_without_exactly_one_known_source_of_time_nodes_use_wall_time() -> None:
    own_simulator = SIMULATED.replace("obelisk_sim_py", "demo")
    hardware = SIMULATED.replace("sim: {", "is_simulated: false, sim: {")
    first = SIMULATED.splitlines()[2]
    two = SIMULATED.replace(first, f"{first}\n{first}")
    assert times(own_simulator) == times(hardware) == [None, None, None]
    assert times(two) == [None, None, None, None]
