"""Saving parameters of running nodes in a config: only these change, and failures are named."""

from pathlib import Path

import pytest

from obk_cli.compiler import Options
from obk_cli.configedit.save_params import SavedParameters, save_parameters

CONFIG = """\
# The stack.
config: arm
control:
  - pkg: demo_py
    executable: controller
    params:
      kp: 20.0 # [N m/rad]
      gains: [1.0, 2.0]   # of each joint
      limits: {speed: 1.0}
      name: slow
    timers:
      - {key: timer_ctrl, timer_period_sec: 0.01}
estimation:
  - pkg: demo_py
    executable: estimator # no parameters yet
    timers:
      - {key: timer_est, timer_period_sec: 0.01}
"""
CONTROL = "/obelisk_control_0"
ESTIMATION = "/obelisk_estimation_0"


def saved(tmp_path: Path, text: str, values: dict[str, dict[str, object]]) -> SavedParameters:
    (tmp_path / "arm.yaml").write_text(text)
    options = Options(variables={}, working_folder=tmp_path)
    return save_parameters("arm.yaml", options, values)  # type: ignore[arg-type]


def new_text(result: SavedParameters) -> str:
    ((_, text),) = result.files
    return text


@pytest.fixture(autouse=True)
def in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_values_are_replaced_and_comments_stay(tmp_path: Path) -> None:
    values = {
        "kp": 25.5,
        "gains": (3.0, 4.0),
        "limits.speed": 1e-7,
        "name": "true",
    }
    result = saved(tmp_path, CONFIG, {CONTROL: values})
    expected = (
        CONFIG.replace("20.0 #", "25.5 #")
        .replace("[1.0, 2.0]", "[3.0, 4.0]")
        .replace("{speed: 1.0}", "{speed: 0.0000001}")
        .replace("name: slow", 'name: "true"')
    )
    assert new_text(result) == expected
    assert {one.name: one.before for one in result.parameters}["kp"] == 20.0
    assert not any(one.fault for one in result.parameters)


def test_new_values_are_added_below_the_others(tmp_path: Path) -> None:
    result = saved(tmp_path, CONFIG, {CONTROL: {"kd": 2.0}, ESTIMATION: {"a": 0.5, "b": 2}})
    text = new_text(result)
    assert "      name: slow\n      kd: 2.0\n    timers:" in text
    added = "executable: estimator # no parameters yet\n    params:\n      a: 0.5\n      b: 2\n"
    assert added in text


def test_equal_values_change_nothing(tmp_path: Path) -> None:
    result = saved(tmp_path, CONFIG, {CONTROL: {"kp": 20.0, "name": "slow"}, "/other": {"x": 1}})
    assert result == SavedParameters()


@pytest.mark.parametrize(
    ("old", "new", "name", "fault"),
    [
        ("kp: 20.0", "kp: ${KP:-20.0}", "kp", "variable"),
        ("name: slow", "name: &n slow\n      other: *n", "name", "more than this value"),
        ("gains: [1.0, 2.0] ", "gains:\n        - 1.0\n        - 2.0 ", "gains", "several lines"),
    ],
)
def test_unwritable_values_are_named_and_kept(
    tmp_path: Path, old: str, new: str, name: str, fault: str
) -> None:
    text = CONFIG.replace(old, new)
    value = {"kp": 1.0, "name": "fast", "gains": (5.0, 6.0)}[name]
    result = saved(tmp_path, text, {CONTROL: {name: value}})
    (one,) = result.parameters
    assert fault in one.fault
    assert result.files == ()


def test_a_config_with_errors_is_not_written(tmp_path: Path) -> None:
    result = saved(tmp_path, CONFIG.replace("config: arm", "config: ["), {CONTROL: {"kp": 1.0}})
    assert result.findings
    assert result.files == ()
