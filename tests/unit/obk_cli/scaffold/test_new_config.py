"""`obk new config`: a config of the existing nodes and model."""

import json
import shutil
from pathlib import Path

import pytest

from obk_cli.compiler import Options, compile_config
from obk_cli.errors import MisuseError

from .new_command import empty_workspace, obk_new, refused


@pytest.fixture(autouse=True)
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty workspace as the working folder."""
    return empty_workspace(tmp_path / "ws", monkeypatch)


@pytest.mark.mujoco
def test_the_printed_entry_is_valid_in_the_example(workspace: Path, repository: Path) -> None:
    example = (repository / "examples/dummy/dummy_new.yaml").read_text()
    shutil.copy(repository / "examples/dummy/dummy.xml", workspace)
    made = [
        json.loads(obk_new(kind, name, "--format", "json"))
        for kind, name in (("controller", "my_control"), ("estimator", "my_estimate"))
    ]
    nodes = "".join(f"{node['section']}:\n{node['config']}\n" for node in made)
    nodes = nodes.replace("/STACK/", "/obelisk/dummy/")
    robot = "robot:" + example.partition("\nrobot:")[2]
    (workspace / "config.yaml").write_text(f"config: mine\n{nodes}{robot}")
    options = Options(variables={}, working_folder=workspace)
    outcome = compile_config("config.yaml", options)
    faults = [str(d) for d in outcome.diagnostics if d.severity != "info"]
    # The simulator's package exists only if the tool is installed.
    assert [fault for fault in faults if "`obelisk_sim_py`" not in fault] == []
    assert outcome.config is not None


def test_a_config_takes_nodes_that_fit_together(workspace: Path) -> None:
    obk_new("controller", "a_control")
    obk_new("estimator", "a_estimate", "--sensor-msg", "ObkImu")
    obk_new("estimator", "b_estimate", "--sensor-msg", "ObkJointEncoders")
    obk_new("robot", "a_robot", "--sensor-msg", "JointEncoders")
    obk_new("robot", "b_robot", "--sensor-msg", "ObkJointEncoders")
    obk_new("config", "stack")
    outcome = compile_config("stack.yaml", Options(variables={}, working_folder=workspace))
    assert outcome.config is not None
    executables = {node.executable.value for node in outcome.config.nodes}
    assert executables == {"a_control", "b_estimate", "b_robot"}
    assert [str(d) for d in outcome.diagnostics if d.severity != "info"] == []


def test_a_config_joins_the_nodes_of_the_workspace(workspace: Path) -> None:
    obk_new("controller", "my_control", "--ctrl-msg", "VelocityCommand")
    obk_new("estimator", "my_estimate", "--sensor-msg", "ObkJointEncoders")
    obk_new(
        "robot", "my_robot", "--ctrl-msg", "VelocityCommand", "--sensor-msg", "ObkJointEncoders"
    )
    obk_new("sensor", "my_imu")
    assert obk_new("config", "stack").startswith(
        "created the config `stack` in ./\n  create    stack.yaml\n\n"
    )
    outcome = compile_config("stack.yaml", Options(variables={}, working_folder=workspace))
    assert outcome.config is not None
    assert [str(d) for d in outcome.diagnostics if d.severity != "info"] == []
    executables = {node.executable.value for node in outcome.config.nodes}
    assert executables == {"my_control", "my_estimate", "my_robot", "my_imu"}


@pytest.mark.mujoco
def test_a_config_without_a_robot_simulates_the_existing_model(workspace: Path) -> None:
    obk_new("controller", "my_control")
    obk_new("estimator", "my_estimate", "--sensor-msg", "ObkImu")
    obk_new("config", "one")
    assert (workspace / "one.xml").is_file()
    (workspace / "model/a.xml").mkdir(parents=True)
    (workspace / "one.xml").rename(workspace / "model/arm.xml")
    obk_new("config", "two")
    text = (workspace / "two.yaml").read_text()
    assert "model_xml_path: model/arm.xml" in text
    assert "tip_gyro: gyro" in text
    assert not (workspace / "two.xml").exists()
    outcome = compile_config("two.yaml", Options(variables={}, working_folder=workspace))
    faults = [str(d) for d in outcome.diagnostics if d.severity != "info"]
    # The simulator's package exists only if the tool is installed.
    assert [fault for fault in faults if "`obelisk_sim_py`" not in fault] == []


def test_a_config_lists_the_sensors_that_its_model_lacks(workspace: Path) -> None:
    obk_new("estimator", "my_estimate", "--sensor-msg", "ObkJointEncoders")
    (workspace / "arm.xml").write_text("<mujoco/>")
    obk_new("config", "arm")
    text = (workspace / "arm.yaml").read_text()
    assert (
        "# ObkJointEncoders: arm.xml names no sensors for it (`jointpos` and `jointvel`)." in text
    )
    assert "sensor_settings:" not in text


def test_a_config_goes_into_the_working_folder_and_may_have_the_name_of_a_package(
    workspace: Path,
) -> None:
    obk_new("controller", "foo")
    obk_new("config", "foo")
    assert (workspace / "foo.yaml").is_file()
    assert isinstance(refused("config", "../foo"), MisuseError)
