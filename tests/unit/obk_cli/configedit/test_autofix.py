"""`obk validate --fix`: what is fixed, what is left, and that no file becomes worse."""

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from obk_cli.cli.main import main
from obk_cli.compiler import Options
from obk_cli.configedit.autofix import Fixed, fix_config

VALID_TEXT = """\
config: d
control:
  - pkg: demo
    executable: c  # runs
    publishers:
      - {key: pub_ctrl, topic: /ctrl, msg_type: PositionSetpoint}
    subscribers:
      - key: sub_est
        topic: /estimate
        msg_type: EstimatedState
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
FAULTS = (
    ("estimation:\n", "estmation:\n"),
    ("executable: c  # runs", "excutable: c  # runs"),
    (
        "topic: /ctrl, msg_type: PositionSetpoint}\n    sub",
        "topci: /ctrl, msg_type: PositionSetpont}\n    sub",
    ),
    ("        topic: /estimate", "        topic: /estimat"),
    ("{key: sub_sensor, topic: /joint_encoders", "{key: sub_sensor, topic: /joint_encodres"),
    ("key: sub_ctrl", "callback_key: y, key: sub_ctrl, history_depth: 10"),
)


def options(folder: Path) -> Options:
    return Options(variables={}, working_folder=folder, ignore=("OBK4",))


def fix(path: Path, allowed: bool = True) -> Fixed:
    return fix_config(str(path), options(path.parent), lambda _: allowed)


def with_faults() -> str:
    text = VALID_TEXT
    for right, wrong in FAULTS:
        assert right in text
        text = text.replace(right, wrong)
    return text


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[object, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["validate", "--ignore", "OBK4", *arguments])
    out, err = capsys.readouterr()
    return ended.value.code, out, err


def test_typing_mistakes_are_fixed(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(with_faults())
    fixed = fix(path)
    ((source, text),) = fixed.files
    assert text == VALID_TEXT
    assert source.text == with_faults() == path.read_text()
    assert fixed.after.diagnostics == ()


@pytest.mark.parametrize(("right", "wrong"), FAULTS)
def test_each_mistake_alone_is_fixed(tmp_path: Path, right: str, wrong: str) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(VALID_TEXT.replace(right, wrong))
    fixed = fix(path)
    ((_, text),) = fixed.files
    assert (text, fixed.refused, fixed.after.diagnostics) == (VALID_TEXT, (), ())


def test_a_valid_config_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(VALID_TEXT)
    fixed = fix(path)
    assert (fixed.files, fixed.done) == ((), ())


def test_a_fix_that_would_change_the_stack_is_undone(tmp_path: Path) -> None:
    inner = tmp_path / "inner.yaml"
    inner.write_text(VALID_TEXT.replace("topic: /ctrl,", "topic: /ctrl, history_depth: 5,"))
    path = tmp_path / "c.yaml"
    path.write_text(
        "include: inner.yaml\nrobot:\n  subscribers:\n"
        "    - key: sub_ctrl\n      history_depth: 10\n      callback_key: x\n"
    )
    fixed = fix(path)
    ((_, text),) = fixed.files
    assert [f.code for f in fixed.refused] == ["OBK507"]
    assert [f.code for f in fixed.done] == ["OBK506"]
    assert text == path.read_text().replace("      callback_key: x\n", "")


def test_a_fix_that_moves_a_rate_to_another_line_is_kept(tmp_path: Path) -> None:
    timers = "    timers:\n      - key: timer_ctrl\n        timer_period_sec: 0.01\n"
    sound = VALID_TEXT.replace("estimation:\n", f"{timers}estimation:\n")
    path = tmp_path / "c.yaml"
    path.write_text(
        sound.replace("/estimate\n        msg", "/estimate\n        callback_key: x\n        msg")
    )
    fixed = fix(path)
    ((_, text),) = fixed.files
    assert ([f.code for f in fixed.done], fixed.refused) == (["OBK506"], ())
    assert text == sound


def test_a_fix_that_leads_to_more_errors_is_undone(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(
        VALID_TEXT + "  sim: {model_xml_path: m.xml, sensor_setings: [{a: 1}, {b: 2}]}\n"
    )
    fixed = fix(path)
    assert [f.message for f in fixed.refused] == ["`sensor_setings` is not a valid key of `sim`"]
    assert fixed.files == ()
    assert fixed.after.diagnostics == fixed.before.diagnostics


@pytest.mark.mujoco
def test_a_sensor_is_renamed_unless_the_name_is_taken(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text(
        '<mujoco><worldbody><body><joint name="j" type="hinge"/><geom size="1"/></body></worldbody>'
        '<sensor><jointpos name="angle" joint="j"/></sensor></mujoco>'
    )
    path = tmp_path / "c.yaml"
    sim = "  sim: {model_xml_path: m.xml, sensor_settings: [{topic: /s, dt: 1, "
    for names, after in (
        ("angel: jointpos", "angle: jointpos"),
        ("angle: jointpos, angel: jointpos", None),
    ):
        text = f"{VALID_TEXT}{sim}msg_type: JointEncoders, sensor_names: {{{names}}}}}]}}\n"
        path.write_text(text)
        files = [new for _, new in fix(path).files]
        assert files == ([text.replace(names, after)] if after else [])


def test_files_that_may_not_be_edited_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(with_faults())
    fixed = fix(path, allowed=False)
    assert fixed.files == ()
    assert fixed.done == ()
    assert "OBK101" in {f.code for f in fixed.outside}


def test_the_command_writes_and_reports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    path = Path("c.yaml")
    path.write_text(
        VALID_TEXT.replace("executable: c", "excutable: c").replace("\n", "\r\n"), newline=""
    )
    code, out, err = run(capsys, "c.yaml", "--fix")
    assert (code, err) == (0, "")
    assert out == (
        "fixed c.yaml:4:5: error[OBK101]: `excutable` is not a valid key of a node of `control`: "
        "now executable\nc.yaml: no findings\n"
    )
    assert path.read_bytes().decode() == VALID_TEXT.replace("\n", "\r\n")


def test_diff_shows_and_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    wrong = VALID_TEXT.replace("executable: c", "excutable: c")
    Path("c.yaml").write_text(wrong)
    code, out, err = run(capsys, "c.yaml", "--fix", "--diff")
    assert code == 1
    assert "-    excutable: c  # runs\n+    executable: c  # runs\n" in out
    assert err.startswith("would fix c.yaml:4:5: error[OBK101]: ")
    assert Path("c.yaml").read_text() == wrong


def test_an_included_file_is_fixed_inside_the_folder_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = VALID_TEXT.replace("executable: c", "excutable: c")
    folder = tmp_path / "stack"
    (folder / "parts").mkdir(parents=True)
    monkeypatch.chdir(folder)
    for fragment in (folder / "parts/inside.yaml", tmp_path / "outside.yaml"):
        fragment.write_text(wrong)
    Path("in.yaml").write_text("include: parts/inside.yaml\n")
    Path("out.yaml").write_text("include: ../outside.yaml\n")
    assert run(capsys, "in.yaml", "--fix")[0] == 0
    assert (folder / "parts/inside.yaml").read_text() == VALID_TEXT
    code, out, _ = run(capsys, "out.yaml", "--fix")
    assert code == 1
    assert out.startswith(
        "skipped because the file is outside the config's folder: ../outside.yaml:4:5: "
    )
    assert (tmp_path / "outside.yaml").read_text() == wrong


def test_other_formats_keep_the_output_to_themselves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("c.yaml").write_text(VALID_TEXT.replace("executable: c", "excutable: c"))
    code, out, err = run(capsys, "c.yaml", "--fix", "--format", "json")
    assert (code, json.loads(out)["diagnostics"]) == (0, [])
    assert err.startswith("fixed c.yaml:4:5: ")


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (("c.yaml", "--diff"), "`--diff` needs `--fix`"),
        (("-", "--fix"), "`--fix` needs files, not standard input"),
        (("-", "--watch"), "`--watch` needs files, not standard input"),
        (("c.yaml", "--watch", "--fix"), "`--watch` cannot be combined with `--fix`"),
        (
            ("c.yaml", "--watch", "--format", "json"),
            "`--watch` cannot be combined with `--format json`",
        ),
    ],
)
def test_misuse(capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], error: str) -> None:
    assert run(capsys, *arguments) == (2, "", f"error: {error}\n")


def test_a_file_that_is_included_by_two_paths_is_fixed_once_and_completely(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    part = Path("part.yaml")
    part.write_text("estmation:\n  pkg: demo\n  excutable: e\n")
    Path("link.yaml").symlink_to("part.yaml")
    Path("c.yaml").write_text(f"include: [part.yaml, link.yaml, {tmp_path}/part.yaml]\n")
    fixed = fix_config("c.yaml", options(tmp_path), lambda _: True)
    ((_, text),) = fixed.files
    assert text == "estimation:\n  pkg: demo\n  executable: e\n"
    assert "OBK101" not in {f.code for f in fixed.after.diagnostics}


BLOCK = """\
config: d
control:
  - pkg: demo
    executable: c
    callback_groups:
      loop: MutuallyExclusiveCallbackGroup
    publishers:
      - ros_parameter: pub_ctrl_setting
        key: pub_ctrl
        topic: /ctrl
        msg_type: PositionSetpoint
        qos:
          reliability: best_effort
    subscribers:
      - key: sub_est
        topic: /estimate
        msg_type: EstimatedState
    timers:
      - key: timer_ctrl
        callback_group: loop
        timer_period_sec: 0.01
estimation:
  - pkg: demo
    executable: e
    publishers:
      - key: pub_est
        topic: /estimate
        msg_type: EstimatedState
    subscribers:
      - key: sub_sensor
        topic: /joint_encoders
        msg_type: ObkJointEncoders
    timers:
      - key: timer_est
        timer_period_sec: 0.02
robot:
  - pkg: demo
    executable: r
    subscribers:
      - key: sub_ctrl
        topic: /ctrl
        msg_type: PositionSetpoint
        qos:
          reliability: best_effort
    sim:
      - model_xml_path: m.xml
        sensor_settings:
          - topic: /joint_encoders
            dt: 0.02
            msg_type: ObkJointEncoders
            sensor_names:
              angle: jointpos
"""
FLOW = """\
config: d
control: [{pkg: demo, executable: c,
  callback_groups: {loop: MutuallyExclusiveCallbackGroup},
  publishers: [{ros_parameter: pub_ctrl_setting, key: pub_ctrl, topic: /ctrl,
    msg_type: PositionSetpoint, qos: {reliability: best_effort}}],
  subscribers: [{key: sub_est, topic: /estimate, msg_type: EstimatedState}],
  timers: [{key: timer_ctrl, callback_group: loop, timer_period_sec: 0.01}]}]
estimation: [{pkg: demo, executable: e,
  publishers: [{key: pub_est, topic: /estimate, msg_type: EstimatedState}],
  subscribers: [{key: sub_sensor, topic: /joint_encoders, msg_type: ObkJointEncoders}],
  timers: [{key: timer_est, timer_period_sec: 0.02}]}]
robot: [{pkg: demo, executable: r,
  subscribers: [{key: sub_ctrl, topic: /ctrl, msg_type: PositionSetpoint,
    qos: {reliability: best_effort}}],
  sim: [{model_xml_path: m.xml, sensor_settings: [{topic: /joint_encoders,
    dt: 0.02, msg_type: ObkJointEncoders, sensor_names: {angle: jointpos}}]}]}]
"""
INSERTED = {
    "OBK506": "callback_key: x",
    "OBK507": "callback_group: None",
}
RESPELT = {
    "OBK101": ("executable: c", "excutable: c"),
    "OBK105": ("best_effort", "best_efort"),
    "OBK107": ("key: pub_ctrl", "key: pub_ctlr"),
    "OBK115": ("msg_type: EstimatedState", "msg_type: EstimatedSate"),
    "OBK203": ("key: sub_est\n        topic: /estimate", "key: sub_est\n        topic: /estimte"),
    "OBK207": ("group: loop", "group: lop"),
    "OBK303": ("angle: jointpos", "agnle: jointpos"),
    "OBK501": (
        "dt: 0.02\n            msg_type: Obk",
        "dt: 0.02\n            sensor_type: Obk",
    ),
}


def flow_of(text: str) -> str:
    return re.sub(r"\n +", ", ", text)


def faulty_texts() -> Iterator[object]:
    """Each fix, in a config in block style and in one in flow style."""
    for code, entry in INSERTED.items():
        wrong = f"{entry}\n        topic: /estimate"
        yield pytest.param(code, BLOCK, "topic: /estimate", wrong, id=f"{code}-block")
        yield pytest.param(code, FLOW, "topic: /estimate", flow_of(wrong), id=f"{code}-flow")
        period = "timer_period_sec: 0.02"
        timer = f"{entry}\n        {period}"
        yield pytest.param(code, BLOCK, period, timer, id=f"{code}-block-timer")
        yield pytest.param(code, FLOW, period, flow_of(timer), id=f"{code}-flow-timer")
    for code, (right, wrong) in RESPELT.items():
        yield pytest.param(code, BLOCK, right, wrong, id=f"{code}-block")
        yield pytest.param(code, FLOW, flow_of(right), flow_of(wrong), id=f"{code}-flow")


@pytest.mark.mujoco
@pytest.mark.parametrize(("code", "sound", "right", "wrong"), [*faulty_texts()])
def test_each_fix_is_applied_in_block_and_in_flow_style(
    tmp_path: Path, code: str, sound: str, right: str, wrong: str
) -> None:
    (tmp_path / "m.xml").write_text(
        '<mujoco><option timestep="0.02"/><worldbody><body><joint name="j" type="hinge"/>'
        '<geom size="1"/></body></worldbody><actuator><motor joint="j"/></actuator>'
        '<sensor><jointpos name="angle" joint="j"/></sensor></mujoco>'
    )
    assert right in sound
    path = tmp_path / "c.yaml"
    path.write_text(sound.replace(right, wrong, 1))
    fixed = fix(path)
    assert fixed.refused == ()
    assert code in {finding.code for finding in fixed.done}
    ((_, text),) = fixed.files
    assert text == sound


@pytest.mark.mujoco
@pytest.mark.parametrize("name", ["dummy.yaml", "dummy_new.yaml"])
def test_the_fixes_of_the_example_are_applied(tmp_path: Path, repository: Path, name: str) -> None:
    folder = tmp_path / "dummy"
    shutil.copytree(repository / "examples" / "dummy", folder)
    fixed = fix(folder / name)
    assert fixed.refused == ()
    fixable = [finding for finding in fixed.after.diagnostics if finding.fix]
    assert fixable == []
