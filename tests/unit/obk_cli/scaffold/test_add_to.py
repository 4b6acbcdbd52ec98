"""`obk new ... --add-to` creates the package and the config's entry together, or neither."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from obk_cli.cli.init import command as make_workspace
from obk_cli.cli.new import app
from obk_cli.compiler import Options, compile_config
from obk_cli.errors import CommandFailedError, MisuseError, ObkError

EXAMPLE = Path(__file__).resolve().parents[4] / "examples" / "dummy"


@pytest.fixture(autouse=True)
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A workspace with the example's config, set as the working folder."""
    folder = tmp_path / "ws"
    (folder / "src").mkdir(parents=True)
    shutil.copytree(EXAMPLE, folder / "config")
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def config(workspace: Path) -> Path:
    return workspace / "config" / "dummy.yaml"


def obk_new(*arguments: str) -> str:
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


def refused(*arguments: str) -> ObkError:
    result = CliRunner().invoke(app, arguments)
    assert isinstance(result.exception, ObkError), result.output
    return result.exception


def errors(config: Path) -> list[str]:
    options = Options(variables={}, working_folder=Path.cwd())
    outcome = compile_config(str(config), options)
    return [str(finding) for finding in outcome.diagnostics if finding.severity != "info"]


def hazards(config: Path) -> set[str]:
    """The rules about lockstep runs that have findings."""
    options = Options(variables={}, working_folder=Path.cwd(), for_test=True)
    return {finding.code for finding in compile_config(str(config), options).hazards}


@pytest.mark.mujoco
@pytest.mark.parametrize(
    "arguments",
    [
        ("controller", "foo"),
        ("controller", "foo", "--lang", "cpp"),
        ("estimator", "foo"),
        ("robot", "foo"),
        ("sensor", "foo"),
        ("controller", "foo", "--replace", "obelisk_control_0"),
    ],
    ids=" ".join,
)
def test_the_config_is_as_valid_with_the_new_node(
    arguments: tuple[str, ...], config: Path, workspace: Path
) -> None:
    reported = obk_new(*arguments, "--add-to", "config/dummy.yaml")
    assert "added to config/dummy.yaml:\n" in reported
    assert reported.endswith(
        ("obk launch config/dummy.yaml\n", "colcon build --packages-select foo\n")
    )
    assert (workspace / "src/foo/package.xml").is_file()
    assert "pkg: foo\n" in config.read_text()
    is_built_later = "cpp" in arguments
    assert ("until it is built" in reported) == is_built_later
    assert [error for error in errors(config) if not is_built_later or "OBK402" not in error] == []
    by_nature = "OBK611" if is_built_later else "OBK613"
    assert hazards(config) == ({by_nature} if is_built_later or "robot" in arguments else set())


def test_a_node_more_in_a_package_joins_too(
    config: Path, workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    obk_new("controller", "foo")
    monkeypatch.chdir(workspace / "src" / "foo")
    obk_new("controller", "bar", "--add-to", "../../config/dummy.yaml")
    assert "    - pkg: foo\n      executable: bar\n" in config.read_text()


@pytest.fixture
def fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The config of a workspace from `obk init`, outside the working folder."""
    monkeypatch.chdir(tmp_path)
    init = typer.Typer()
    init.command()(make_workspace)
    assert CliRunner().invoke(init, ["arm"], catch_exceptions=False).exit_code == 0
    monkeypatch.chdir(tmp_path / "arm")
    return tmp_path / "arm" / "arm.yaml"


@pytest.mark.mujoco
@pytest.mark.parametrize(
    "arguments",
    [
        ("estimator", "foo"),
        ("robot", "foo", "--replace", "obelisk_robot_0"),
    ],
    ids=" ".join,
)
def test_a_type_that_was_left_open_is_the_configs(arguments: tuple[str, ...], fresh: Path) -> None:
    assert "/arm/encoders (ObkJointEncoders)" in obk_new(*arguments, "--add-to", "arm.yaml")
    assert errors(fresh) == []


@pytest.mark.mujoco
@pytest.mark.parametrize(
    ("arguments", "topic"),
    [
        (("controller", "foo", "--replace", "obelisk_control_0"), "/arm/ctrl"),
        (("estimator", "foo", "--replace", "obelisk_estimation_0"), "/arm/est"),
        (("robot", "foo", "--replace", "obelisk_robot_0"), None),
    ],
    ids=["controller", "estimator", "robot"],
)
def test_its_test_runs_the_stack_unless_a_robot_is_hardware(
    arguments: tuple[str, ...], topic: str | None, fresh: Path
) -> None:
    obk_new(*arguments, "--add-to", "arm.yaml")
    test = (fresh.parent / "src/foo/test/test_foo.py").read_text()
    assert ('stack("../../../arm.yaml", seed=seed)' in test) == (topic is not None)
    assert topic is None or f'run["{topic}"]' in test


@pytest.mark.mujoco
def test_its_test_leaves_out_a_stack_that_cannot_be_in_lock_step(fresh: Path) -> None:
    obk_new("controller", "bar", "--lang", "cpp", "--add-to", "arm.yaml")
    obk_new("sensor", "foo", "--add-to", "arm.yaml")
    assert "arm.yaml" not in (fresh.parent / "src/foo/test/test_foo.py").read_text()


@pytest.mark.ros
@pytest.mark.mujoco
def test_its_test_passes_immediately(fresh: Path) -> None:
    obk_new("controller", "foo", "--replace", "obelisk_control_0", "--add-to", "arm.yaml")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "src/foo"],
        cwd=fresh.parent,
        env=os.environ | {"ROS_LOG_DIR": str(fresh.parent / "log")},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 passed" in done.stdout


def test_a_requested_type_is_not_exchanged(fresh: Path) -> None:
    error = refused("estimator", "foo", "--sensor-msg", "JointEncoders", "--add-to", "arm.yaml")
    assert error.message.startswith("nothing in `robot` or `sensing` publishes JointEncoders")


def test_the_usual_type_is_kept_if_the_config_has_it(config: Path) -> None:
    assert "(JointEncoders)" in obk_new("estimator", "foo", "--add-to", str(config), "--dry-run")


def test_a_config_that_cannot_take_the_node_leaves_everything(
    config: Path, workspace: Path
) -> None:
    before = config.read_bytes()
    error = refused("estimator", "foo", "--sensor-msg", "ObkForceSensor", "--add-to", str(config))
    assert isinstance(error, CommandFailedError)
    assert error.message.startswith("nothing in `robot` or `sensing` publishes ObkForceSensor")
    assert error.help is not None
    assert error.help.endswith("make the node for one of these types with `--sensor-msg`")
    assert config.read_bytes() == before
    assert list((workspace / "src").iterdir()) == []


def test_a_package_that_the_config_would_not_find_is_not_created(
    config: Path, workspace: Path, tmp_path: Path
) -> None:
    before = config.read_bytes()
    elsewhere = tmp_path / "elsewhere" / "src"
    error = refused("controller", "foo", "--dest", str(elsewhere), "--add-to", str(config))
    assert "nothing was created" in error.message
    assert config.read_bytes() == before
    assert not elsewhere.exists()


def test_from_outside_a_workspace_the_package_goes_into_the_configs(
    config: Path, workspace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    reported = obk_new("controller", "foo", "--add-to", "ws/config/dummy.yaml")
    assert "in ws/src/foo/\n" in reported
    assert "pytest ws/src/foo/test/test_foo.py\n" in reported
    assert (workspace / "src/foo/package.xml").is_file()


def test_a_package_in_another_workspace_is_kept(
    config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "other" / "src").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "other")
    reported = obk_new("controller", "foo", "--add-to", str(config))
    assert "in src/foo/\n" in reported


def test_an_existing_package_is_as_it_was_if_the_config_cannot_be_written(
    config: Path, workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    obk_new("controller", "foo")
    package = workspace / "src" / "foo"
    before = {path: path.read_bytes() for path in package.rglob("*") if path.is_file()}
    text = config.read_bytes()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("obk_cli.configedit.edited_files.write_bytes", full)
    monkeypatch.chdir(package)
    error = refused("controller", "bar", "--add-to", str(config))
    assert "cannot be written" in error.message
    assert {p: p.read_bytes() for p in package.rglob("*") if p.is_file()} == before
    assert config.read_bytes() == text


def test_mode_and_symbolic_link_of_the_config_stay(config: Path, workspace: Path) -> None:
    config.chmod(0o640)
    link = workspace / "config" / "link.yaml"
    link.symlink_to("dummy.yaml")
    obk_new("controller", "foo", "--add-to", "config/link.yaml")
    assert link.is_symlink()
    assert config.stat().st_mode & 0o777 == 0o640
    assert "pkg: foo\n" in config.read_text()


def test_a_dry_run_shows_the_diff_of_the_config_and_changes_nothing(
    config: Path, workspace: Path
) -> None:
    before = config.read_bytes()
    reported = obk_new("sensor", "foo", "--add-to", "config/dummy.yaml", "--dry-run")
    assert "`/obelisk_sensing_0` would be added to config/dummy.yaml:\n" in reported
    assert "+++ b/config/dummy.yaml\n" in reported
    assert "+    - pkg: foo\n" in reported
    assert config.read_bytes() == before
    assert list((workspace / "src").iterdir()) == []


def test_json_lists_the_connections(config: Path) -> None:
    reported = json.loads(obk_new("robot", "foo", "--add-to", str(config), "--format", "json"))
    added = reported["added_to"]
    assert added["node"] == "/obelisk_robot_1"
    assert [(link["component"], link["topic"]) for link in added["links"]] == [
        ("sub_ctrl", "/obelisk/dummy/ctrl"),
        ("pub_sensor", "/obelisk/dummy/foo/joint_encoders"),
    ]
    assert added["timers"][0]["period_s"] == 0.001


@pytest.mark.parametrize(
    "options", [("--device", "onboard"), ("--replace", "a"), ("--add-to", "-")], ids=" ".join
)
def test_options_that_need_a_config_are_rejected_without_one(options: tuple[str, ...]) -> None:
    assert isinstance(refused("controller", "foo", *options), MisuseError)


def test_a_missing_config_is_reported(workspace: Path) -> None:
    error = refused("controller", "foo", "--add-to", "none.yaml")
    assert error.message.startswith("`none.yaml` cannot be read")
    assert list((workspace / "src").iterdir()) == []


@pytest.mark.mujoco
@pytest.mark.parametrize(
    ("options", "next_command", "is_published"),
    [
        ((), "obk launch arm.yaml", True),
        (("--est-msg", "TrueSimState"), "obk validate arm.yaml", False),
    ],
)
def test_a_topic_that_loses_its_only_publisher_is_reported(
    options: tuple[str, ...], next_command: str, is_published: bool, fresh: Path
) -> None:
    replacing = ("--add-to", "arm.yaml", "--replace", "obelisk_estimation_0")
    result = json.loads(obk_new("estimator", "foo", *options, *replacing, "--format", "json"))
    lost = [note for note in result["added_to"]["notes"] if "`/arm/est`" in note]
    assert len(lost) == (0 if is_published else 1)
    assert is_published or "`/obelisk_control_0`" in lost[0]
    assert result["next"][-1].endswith(next_command)
