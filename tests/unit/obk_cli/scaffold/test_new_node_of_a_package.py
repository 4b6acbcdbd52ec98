"""`obk new` in a package adds a node to it, or reports why that is not possible."""

from collections.abc import Callable
from pathlib import Path

import pytest

from obk_cli.config.environment import Command
from obk_cli.workspace.package_index import PackageIndex

from .new_command import empty_workspace, obk_new, refused

Tree = Callable[[Path], dict[str, bytes]]


@pytest.fixture(autouse=True)
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty workspace as the working folder."""
    return empty_workspace(tmp_path / "ws", monkeypatch)


def test_inside_a_package_a_node_is_added(
    workspace: Path, tree: Tree, monkeypatch: pytest.MonkeyPatch
) -> None:
    obk_new("controller", "foo")
    before = tree(workspace / "src/foo")
    monkeypatch.chdir(workspace / "src/foo")
    output = obk_new("estimator", "second", "--sensor-msg", "ObkImu")
    assert output.startswith("created the estimator `second`, package `foo`, in ./\n")
    after = tree(workspace / "src/foo")
    changed = {path for path in after if after[path] != before.get(path)}
    assert changed == {
        "foo/second.py",
        "package.xml",
        "setup.py",
        "test/second.yaml",
        "test/test_second.py",
    }
    assert b"<exec_depend>obelisk_sensor_msgs</exec_depend>" in after["package.xml"]
    index = PackageIndex.around(workspace, workspace, {})
    for executable in ("foo", "second"):
        assert isinstance(index.find_executable("foo", executable), Command)


@pytest.mark.parametrize(
    ("manifest", "sentence"),
    [
        ("<package><name>foo</name></package>", "the build type `catkin`"),
        ("nothing", "is not a valid package.xml"),
        (
            "<package><name>foo</name><export><build_type>ament_python</build_type></export>"
            "</package>",
            "has no module `foo/__init__.py`",
        ),
    ],
)
def test_a_package_that_cannot_take_a_node_is_reported_so(
    workspace: Path, tree: Tree, manifest: str, sentence: str
) -> None:
    (workspace / "package.xml").write_text(manifest)
    fault = refused("controller", "foo")
    assert sentence in fault.message
    assert fault.help is not None
    assert "--dest" in fault.help
    assert list(tree(workspace)) == ["package.xml"]


def test_a_setup_that_is_not_plain_stops_the_addition(
    workspace: Path, tree: Tree, monkeypatch: pytest.MonkeyPatch
) -> None:
    obk_new("controller", "foo")
    (workspace / "src/foo/setup.py").write_text("setup()")
    before = tree(workspace)
    monkeypatch.chdir(workspace / "src/foo")
    assert "cannot be added" in refused("controller", "second").message
    assert tree(workspace) == before


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("msgs", "my_msgs"), "messages need a package of their own"),
        (("controller", "bar", "--lang", "cpp"), "a C++ node needs a package of its own"),
    ],
)
def test_invalid_package_contents_are_reported(
    workspace: Path,
    tree: Tree,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    sentence: str,
) -> None:
    obk_new("controller", "foo")
    before = tree(workspace)
    monkeypatch.chdir(workspace / "src/foo")
    fault = refused(*arguments)
    assert sentence in fault.message
    assert fault.help is not None
    assert "--dest" in fault.help
    assert tree(workspace) == before


@pytest.mark.parametrize("kind", ["controller", "estimator", "robot", "sensor"])
def test_a_package_with_scripts_in_pyproject_gets_the_node_there(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    root = workspace / "src/foo"
    (root / "src/foo").mkdir(parents=True)
    (root / "src/foo/__init__.py").write_text("")
    (root / "package.xml").write_text(
        "<package><name>foo</name><export><build_type>ament_python</build_type></export>"
        "\n</package>\n"
    )
    (root / "pyproject.toml").write_text('[project]\nname = "foo" # mine\nversion = "1"\n')
    monkeypatch.chdir(root)
    obk_new(kind, "second")
    assert (root / "src/foo/second.py").is_file()
    assert "# mine" in (root / "pyproject.toml").read_text()
    command = PackageIndex.around(workspace, workspace, {}).find_executable("foo", "second")
    assert isinstance(command, Command)
    assert command.python_path == (root / "src",)


def test_deep_inside_a_package_is_inside_it(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    obk_new("controller", "foo")
    monkeypatch.chdir(workspace / "src/foo/foo")
    assert f"in {workspace / 'src/foo'}/\n" in obk_new("sensor", "second")
    assert (workspace / "src/foo/foo/second.py").is_file()


def test_between_the_packages_of_a_workspace_is_outside_of_all(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (workspace / "src/package.xml").write_text("<package><name>outer</name></package>")
    group = workspace / "src/inner/src/group"
    group.mkdir(parents=True)
    monkeypatch.chdir(group)
    obk_new("sensor", "foo")
    assert (group / "foo/package.xml").is_file()
