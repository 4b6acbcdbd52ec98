import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from obk_cli.cli.new import app
from obk_cli.config.environment import Command
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.workspace.package_index import PackageIndex
from obk_interfaces import discover

from .new_command import empty_workspace, obk_new, refused

Tree = Callable[[Path], dict[str, bytes]]


@pytest.fixture(autouse=True)
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty workspace as the working folder."""
    return empty_workspace(tmp_path / "ws", monkeypatch)


def test_a_package_goes_into_src_of_the_workspace(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent))
    output = obk_new("controller", "foo")
    assert output.startswith("created the controller `foo`, package `foo`, in src/foo/\n")
    assert output.endswith(
        "next:\n  python -m pytest src/foo/test/test_foo.py\n  obk launch CONFIG\n"
    )
    assert (workspace / "src/foo/foo/foo.py").is_file()


def test_the_next_commands_work_without_an_active_environment(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "")
    programs = Path(sys.executable).parent
    output = obk_new("controller", "foo")
    assert f"  {programs}/python -m pytest src/foo/test/test_foo.py\n" in output
    assert f"  {programs}/obk launch CONFIG\n" in output


def test_the_snippet_sets_the_parameter_that_the_node_declares(workspace: Path) -> None:
    assert "  params:\n    " in obk_new("controller", "foo").replace("\n  ", "\n")
    assert "amplitude = Parameter(" in (workspace / "src/foo/foo/foo.py").read_text()


def test_the_snippet_names_the_option_that_adds_it(workspace: Path) -> None:
    output = obk_new("estimator", "foo")
    assert "under `estimation:` in your config and replace /STACK" in output
    assert "--add-to CONFIG" in output
    assert "    - key: pub_est\n        topic: /STACK/est\n" in output


def test_a_misspelled_kind_is_reported_with_the_near_one() -> None:
    error = refused("contoller", "foo")
    assert isinstance(error, MisuseError)
    assert error.help == "did you mean `controller`?"


def test_a_missing_message_package_is_reported(workspace: Path) -> None:
    obk_new("msgs", "arm_msgs")
    result = CliRunner().invoke(app, ["controller", "foo", "--ctrl-msg", "arm_msg/Example"])
    assert result.exit_code == 0
    assert result.stderr == (
        "note: the message package `arm_msg` does not exist yet: did you mean `arm_msgs`?\n"
    )
    result = CliRunner().invoke(app, ["controller", "bar", "--ctrl-msg", "later/Example"])
    assert result.stderr == (
        "note: the message package `later` does not exist yet: create it with `obk new "
        "msgs later`\n"
    )
    for known in ("arm_msgs/Example", "ObkJointEncoders", "geometry_msgs/Pose"):
        assert not CliRunner().invoke(app, ["sensor", "baz", "--sensor-msg", known]).stderr
        shutil.rmtree(workspace / "src" / "baz")


def test_without_src_a_package_goes_into_the_working_folder(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(workspace / "src")
    obk_new("estimator", "foo")
    assert (workspace / "src/foo/package.xml").is_file()


def test_dest_chooses_the_folder(workspace: Path) -> None:
    obk_new("controller", "foo", "--dest", "a/b")
    assert (workspace / "a/b/foo/package.xml").is_file()


def test_the_launcher_finds_the_executable_in_the_sources(workspace: Path) -> None:
    obk_new("controller", "foo")
    index = PackageIndex.around(workspace, workspace, {})
    command = index.find_executable("foo", "foo")
    assert isinstance(command, Command)
    assert command.python_path == (workspace / "src/foo",)
    assert "from foo.foo import main" in command.arguments[-1]


def test_a_dry_run_shows_the_tree_and_makes_nothing(workspace: Path, tree: Tree) -> None:
    output = obk_new("controller", "foo", "--dry-run")
    assert output.startswith("would create the controller `foo`")
    assert "  create    foo/foo.py\n" in output
    assert tree(workspace) == {}


def test_the_result_as_json() -> None:
    result = json.loads(obk_new("estimator", "foo", "--format", "json"))
    assert (result["kind"], result["package"], result["folder"]) == ("estimator", "foo", "src/foo")
    assert {"path": "setup.py", "action": "create"} in result["files"]
    assert result["section"] == "estimation"


def test_repeating_the_command_changes_nothing(workspace: Path, tree: Tree) -> None:
    obk_new("controller", "foo")
    before = tree(workspace)
    assert "  identical setup.py\n" in obk_new("controller", "foo")
    assert tree(workspace) == before


def test_a_changed_file_is_never_lost_without_force(workspace: Path, tree: Tree) -> None:
    obk_new("controller", "foo")
    mine = workspace / "src/foo/foo/foo.py"
    mine.write_text("mine")
    (workspace / "src/foo/package.xml").unlink()
    before = tree(workspace)
    fault = refused("controller", "foo")
    assert isinstance(fault, CommandFailedError)
    assert "  foo/foo.py: it has different content" in fault.message
    assert tree(workspace) == before
    assert "  replace   foo/foo.py\n" in obk_new("controller", "foo", "--force")
    assert mine.read_text() != "mine"


@pytest.mark.parametrize("name", ["../x_y", "/tmp/x_y", "FooBar", "class", "json", "std_msgs"])
def test_a_name_that_cannot_be_is_misuse_and_makes_nothing(
    workspace: Path, tree: Tree, name: str
) -> None:
    assert isinstance(refused("controller", name), MisuseError)
    assert tree(workspace.parent) == {}


def test_an_installed_module_is_not_shadowed() -> None:
    assert "is taken: it is an installed Python module" in refused("controller", "jinja2").message


def test_a_package_elsewhere_in_the_workspace_is_not_doubled(workspace: Path) -> None:
    obk_new("controller", "foo", "--dest", "src/group")
    fault = refused("controller", "foo")
    assert f"is taken: it is a ROS package ({workspace / 'src/group/foo'})" in fault.message


def test_all_invalid_options_are_in_one_message() -> None:
    fault = refused("controller", "foo", "--ctrl-msg", "PositionSetpont", "--est-msg", "x")
    assert "`PositionSetpont`" in fault.message
    assert "did you mean `PositionSetpoint`?" in fault.message
    assert "`x`" in fault.message


def test_a_link_that_leads_out_of_the_workspace_is_rejected(
    workspace: Path, tmp_path: Path, tree: Tree
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (workspace / "src/foo").symlink_to(elsewhere)
    fault = refused("controller", "foo")
    assert fault.message == f"src/foo is reached through a symbolic link to {elsewhere}"
    assert fault.help == f"to create the package there, add --dest {tmp_path}"
    (workspace / "src/foo").unlink()
    (workspace / "src").rmdir()
    (workspace / "src").symlink_to(elsewhere)
    assert "symbolic link" in refused("controller", "foo").message
    assert tree(elsewhere) == {}


def test_a_link_inside_the_package_is_not_followed_out(
    workspace: Path, tmp_path: Path, tree: Tree
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (workspace / "src/foo").mkdir()
    (workspace / "src/foo/test").symlink_to(elsewhere)
    fault = refused("controller", "foo", "--force")
    assert f"test/test_foo.py: a symbolic link redirects it to {elsewhere}" in fault.message
    assert tree(elsewhere) == {}


@pytest.mark.parametrize(
    ("actuators", "line"), [(0, "[u]"), (1, "[u]"), (3, "[u, u, u]"), (29, "[u] * 29")]
)
def test_a_controller_writes_as_many_controls_as_the_model_has_actuators(
    workspace: Path, actuators: int, line: str
) -> None:
    motors = "<motor/>" * actuators
    (workspace / "model").mkdir()
    (workspace / "model/arm.xml").write_text(f"<mujoco><actuator>{motors}</actuator></mujoco>")
    obk_new("controller", "foo")
    assert f"        msg.u_mujoco = {line}\n" in (workspace / "src/foo/foo/foo.py").read_text()


def test_a_file_is_an_invalid_destination(workspace: Path) -> None:
    (workspace / "file").write_text("")
    fault = refused("controller", "foo", "--dest", "file")
    assert fault.message == "--dest: file is a file, expected a folder"


def test_a_file_in_the_way_is_reported(workspace: Path) -> None:
    (workspace / "src/foo").write_text("")
    assert "src/foo is a file" in refused("controller", "foo").message


def test_a_dry_run_shows_a_diff_that_patch_takes(
    workspace: Path, tree: Tree, monkeypatch: pytest.MonkeyPatch
) -> None:
    obk_new("controller", "foo")
    root = workspace / "src/foo"
    monkeypatch.chdir(root)
    shown = json.loads(obk_new("sensor", "second", "--dry-run", "--format", "json"))["diff"]
    assert "+++ b/foo/second.py\n" in shown
    assert '+            "second = foo.second:main",\n' in shown
    patched = workspace / "patched"
    shutil.copytree(root, patched)
    subprocess.run(["patch", "-p1", "-s"], cwd=patched, input=shown.encode(), check=True)
    obk_new("sensor", "second")
    assert tree(patched) == tree(root)


def test_a_dry_run_shows_existing_files_and_fails(workspace: Path, tree: Tree) -> None:
    obk_new("controller", "foo")
    (workspace / "src/foo/package.xml").write_text("mine\n")
    before = tree(workspace)
    result = CliRunner().invoke(app, ["controller", "foo", "--dry-run"])
    assert isinstance(result.exception, CommandFailedError)
    assert "  conflict  package.xml\n" in result.stdout
    assert "-mine\n" in result.stdout
    assert tree(workspace) == before


def test_a_message_package_is_one_that_the_builder_takes(workspace: Path) -> None:
    output = obk_new("msgs", "my_msgs", "--srv")
    assert output.startswith("created the message package `my_msgs` in src/my_msgs/\n")
    (package,) = discover([workspace / "src"])
    assert package.name == "my_msgs"
    assert {interface.file for interface in package.interfaces} == {
        "msg/Example.msg",
        "srv/ExampleService.srv",
    }
    cmake = (workspace / "src/my_msgs/CMakeLists.txt").read_text()
    assert '"msg/Example.msg"\n  "srv/ExampleService.srv"\n  DEPENDENCIES std_msgs\n' in cmake


def test_without_srv_a_message_package_has_no_service(workspace: Path) -> None:
    obk_new("msgs", "my_msgs")
    assert not (workspace / "src/my_msgs/srv").exists()
    assert "srv" not in (workspace / "src/my_msgs/CMakeLists.txt").read_text()


@pytest.mark.parametrize("kind", ["controller", "estimator", "robot", "sensor", "msgs", "config"])
def test_every_kind_shows_an_example(kind: str) -> None:
    assert f"Example: obk new {kind} my_" in obk_new(kind, "--help")


@pytest.mark.parametrize("file", ["pyproject.toml", "pytest.ini"])
def test_settings_stand_once_in_a_workspace_that_has_them(
    workspace: Path, tree: Tree, file: str
) -> None:
    obk_new("controller", "alone")
    (workspace / file).write_text("addopts = '-p obk_testing.plugin'\n")
    obk_new("controller", "among_others")
    made = tree(workspace / "src")
    assert "alone/pyproject.toml" in made
    assert "among_others/pyproject.toml" not in made
