import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
import typer

from obk_cli.cli.init import command
from obk_cli.compiler import Options, compile_config
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.install_source import InstallSource

from .new_command import error_of, printed_by

Tree = Callable[[Path], dict[str, bytes]]

OBK = "import sys; from obk_cli.cli.main import main; main(sys.argv[1:])"
app = typer.Typer()
app.command()(command)
obk_init = partial(printed_by, app)
refused = partial(error_of, app)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def test_a_workspace_has_all_that_a_stack_needs(here: Path, tree: Tree) -> None:
    output = obk_init("my_robot")
    assert output.startswith("created the workspace `my_robot` in my_robot/\n")
    made = set(tree(here / "my_robot"))
    assert {
        ".github/workflows/check.yaml",
        ".gitignore",
        ".pre-commit-config.yaml",
        ".vscode/obelisk.schema.json",
        "README.md",
        "model/my_robot.xml",
        "my_robot.yaml",
        "src/my_robot_controller/setup.py",
        "src/my_robot_estimator/my_robot_estimator/my_robot_estimator.py",
        "tests/test_my_robot.py",
    } <= made
    assert not [path for path in made if "{" in path or path.endswith(".jinja")]


def test_it_prints_the_next_commands(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent))
    output = obk_init("my_robot")
    assert output.endswith(
        "next:\n  cd my_robot\n  obk validate my_robot.yaml\n  obk launch my_robot.yaml\n"
        "  obk test my_robot.yaml\n"
    )


def test_a_dot_is_this_folder_and_its_name_the_stacks(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "arm").mkdir()
    monkeypatch.chdir(here / "arm")
    output = obk_init()
    assert "cd " not in output
    assert (here / "arm/arm.yaml").read_text().count("config: arm\n") == 1


def test_the_config_names_the_existing_schema(here: Path) -> None:
    obk_init("my_robot")
    first, *_ = (here / "my_robot/my_robot.yaml").read_text().splitlines()
    marker, _, schema = first.partition("$schema=")
    assert marker == "# yaml-language-server: "
    assert (here / "my_robot" / schema).is_file()


@pytest.mark.mujoco
def test_its_config_is_valid_without_a_finding(here: Path) -> None:
    obk_init("my_robot")
    options = Options(variables={}, working_folder=here, for_test=True)
    outcome = compile_config("my_robot/my_robot.yaml", options)
    found = [str(d) for d in outcome.diagnostics]
    # The simulator's package exists only if the tool is installed.
    assert [fault for fault in found if "`obelisk_sim_py`" not in fault] == []
    assert outcome.config is not None


def test_the_command_for_the_real_robot_is_removed_with_the_simulated_one(here: Path) -> None:
    obk_init("my_robot")
    config = here / "my_robot" / "my_robot.yaml"
    (command_line,) = re.findall("# For the real robot: `obk (.+)`", config.read_text())
    words = [sys.executable, "-c", OBK, *shlex.split(command_line)]
    subprocess.run(words, check=True, cwd=config.parent, stdout=subprocess.DEVNULL)
    text = config.read_text()
    assert "is_simulated: false" in text
    assert "real robot" not in text


@pytest.mark.parametrize(
    ("source", "is_local"),
    [
        (InstallSource(git="git+https://git.invalid/obelisk.git@0123abc"), False),
        (InstallSource(archive="file:///dist/obelisk_cli-0.1.0-py3-none-any.whl"), True),
    ],
)
def test_every_file_installs_obk_from_its_source(
    here: Path, tree: Tree, monkeypatch: pytest.MonkeyPatch, source: InstallSource, is_local: bool
) -> None:
    monkeypatch.setattr("obk_cli.cli.init.read_install_source", lambda: source)
    obk_init("my_robot")
    texts = {path: text.decode() for path, text in tree(here / "my_robot").items()}
    install = source.pip_install("ros", "sim", "test")
    places = {path for path, text in texts.items() if "obelisk-cli" in text}
    assert places == {"README.md", ".github/workflows/check.yaml"}
    for path in places:
        assert texts[path].count("obelisk-cli") == install.count("obelisk-cli") == 1
        assert install in texts[path]
        assert ("only on the machine" in texts[path]) == is_local


def test_repeating_the_command_changes_nothing(here: Path, tree: Tree) -> None:
    obk_init("my_robot")
    before = tree(here)
    output = obk_init("my_robot")
    assert "  create " not in output
    assert "  identical my_robot.yaml\n" in output
    assert tree(here) == before


def test_a_file_with_other_content_is_never_lost(here: Path, tree: Tree) -> None:
    (here / "my_robot").mkdir()
    (here / "my_robot/README.md").write_text("mine")
    before = tree(here)
    fault = refused("my_robot")
    assert isinstance(fault, CommandFailedError)
    assert "README.md: it has different content" in fault.message
    assert fault.help is not None
    assert fault.help.startswith("choose another folder, or move these files")
    assert "--force" not in fault.help  # which `obk init` does not have
    assert tree(here) == before


def test_files_that_are_not_in_the_way_stay(here: Path) -> None:
    (here / "my_robot/.git").mkdir(parents=True)
    (here / "my_robot/.git/HEAD").write_text("ref")
    (here / "my_robot/LICENSE").write_text("mine")
    obk_init("my_robot")
    assert (here / "my_robot/LICENSE").read_text() == "mine"
    assert (here / "my_robot/.git/HEAD").read_text() == "ref"


def test_the_editors_settings_stay_and_an_old_schema_is_replaced(here: Path) -> None:
    folder = here / "my_robot/.vscode"
    folder.mkdir(parents=True)
    (folder / "settings.json").write_text("// mine\n{}\n")
    (folder / "obelisk.schema.json").write_text("{}")
    assert "  edit      .vscode/obelisk.schema.json\n" in obk_init("my_robot")
    assert (folder / "settings.json").read_text() == "// mine\n{}\n"
    assert "properties" in json.loads((folder / "obelisk.schema.json").read_text())


def test_a_dry_run_shows_the_files_and_creates_none(here: Path, tree: Tree) -> None:
    output = obk_init("my_robot", "--dry-run")
    assert "  create    my_robot.yaml\n" in output
    assert "\n--- /dev/null\n+++ b/my_robot.yaml\n" in output
    assert list(here.iterdir()) == []


def test_the_result_as_json() -> None:
    result = json.loads(obk_init("my_robot", "--format", "json"))
    assert (result["stack"], result["folder"]) == ("my_robot", "my_robot")
    assert {"path": "my_robot.yaml", "action": "create"} in result["files"]


@pytest.mark.parametrize("name", ["My-Robot", "2fast", "class", "x" * 30, "with space"])
def test_a_folder_with_a_name_that_is_invalid_for_stacks_is_misuse(
    here: Path, tree: Tree, name: str
) -> None:
    fault = refused(name)
    assert isinstance(fault, MisuseError)
    assert fault.message.startswith(
        "the folder's name would become the stack's name, but the name `"
    )
    assert tree(here) == {}


def test_a_name_whose_packages_exist_is_rejected(here: Path) -> None:
    (here / "arm/src/group/mine").mkdir(parents=True)
    (here / "arm/src/group/mine/package.xml").write_text(
        "<package><name>arm_controller</name></package>"
    )
    assert "`arm_controller` is taken" in refused("arm").message


def test_a_workspace_next_to_another_may_have_its_name(here: Path) -> None:
    obk_init("one/arm")
    obk_init("two/arm")
    assert (here / "two/arm/arm.yaml").is_file()


def test_a_package_cannot_contain_a_workspace(here: Path) -> None:
    (here / "pkg").mkdir()
    (here / "pkg/package.xml").write_text("<package/>")
    assert "is a package" in refused("pkg").message


def test_a_file_cannot_contain_a_workspace(here: Path) -> None:
    (here / "arm").write_text("")
    assert "arm is a file" in refused("arm").message


def test_a_link_to_a_folder_is_that_folder_under_the_links_name(here: Path) -> None:
    (here / "real").mkdir()
    (here / "arm").symlink_to("real")
    obk_init("arm")
    assert (here / "real/arm.yaml").is_file()


def test_a_dangling_link_is_rejected(here: Path) -> None:
    (here / "arm").symlink_to("nowhere")
    assert "which does not exist" in refused("arm").message
    assert not (here / "nowhere").exists()


def test_a_link_inside_is_not_followed_out(here: Path, tmp_path: Path, tree: Tree) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (here / "arm").mkdir()
    (here / "arm/src").symlink_to(elsewhere)
    assert "a symbolic link redirects it to" in refused("arm").message
    assert tree(elsewhere) == {}


def run(folder: Path, *arguments: str) -> str:
    env = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    done = subprocess.run(
        [sys.executable, "-m", *arguments],
        cwd=folder,
        env=env,
        capture_output=True,
        text=True,
        timeout=150,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.mark.slow
def test_the_workspace_passes_ruff_and_mypy(here: Path, mypy_cache: Path) -> None:
    obk_init("my_robot")
    run(here / "my_robot", "ruff", "check", "--no-cache", ".")
    run(here / "my_robot", "ruff", "format", "--no-cache", "--check", ".")
    run(here / "my_robot", "mypy", "--cache-dir", str(mypy_cache))


def test_ruff_ignores_build_output_in_a_workspace_without_git(here: Path) -> None:
    obk_init("my_robot")
    for made_by in (".obk/build", "build", "install", "log"):
        folder = here / "my_robot" / made_by / "my_msgs"
        folder.mkdir(parents=True)
        (folder / "generated.py").write_text("import  os\n")
    run(here / "my_robot", "ruff", "check", "--no-cache", ".")
    run(here / "my_robot", "ruff", "format", "--no-cache", "--check", ".")


@pytest.mark.slow
@pytest.mark.mujoco
def test_the_commands_of_its_readme_work_in_their_order(here: Path) -> None:
    obk_init("my_robot")
    root = here / "my_robot"
    blocks = re.findall(r"```sh\n(.*?)```", (root / "README.md").read_text(), re.DOTALL)
    lines = [shlex.split(line, comments=True) for line in "".join(blocks).splitlines()]
    commands = [words[1:] for words in lines if words[:1] == ["obk"] and words[1] != "launch"]
    usual = ["validate", "test", "new", "new", "new", "graph", "new"]
    assert [words[0] for words in commands] == usual
    for words in (*commands, ["validate", "--strict", "my_robot.yaml"]):
        done = subprocess.run(
            [sys.executable, "-c", OBK, *words],
            cwd=root,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert done.returncode == 0, (words, done.stdout, done.stderr)


@pytest.mark.ros
@pytest.mark.mujoco
def test_the_tests_of_the_workspace_pass(
    here: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OBK_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    obk_init("my_robot")
    node_test = here / "my_robot/src/my_robot_controller/test/test_my_robot_controller.py"
    with node_test.open("a") as file:
        file.write("\n\nfrom my_robot_controller.my_robot_controller import main\n")
    run(here / "my_robot", "pytest", "-q", "-p", "no:cacheprovider")
