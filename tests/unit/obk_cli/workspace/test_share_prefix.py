"""The share folders of packages that run from source, as nodes find them."""

from collections.abc import Mapping
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_path

from obk_cli.workspace.package_index import PackageIndex, package_folders
from obk_cli.workspace.share_prefix import make_share_prefix, with_prefix

SETUP_PY = """\
import os
from glob import glob
from setuptools import setup

package_name = "demo"
data_files = [("share/ament_index/resource_index/packages", ["resource/" + package_name])]
data_files += [(f"share/{package_name}/gains", glob("resource/*.yaml"))]
data_files.append((os.path.join("share", package_name, "config"), ["extra/more.yaml"]))
data_files.extend([walked(folder) for folder in os.walk("models")])
setup(
    name=package_name,
    data_files=[
        ("share/" + package_name, ["package.xml", "resource/policy.onnx"]),
        (os.path.join("share", package_name, "launch"), sorted(glob(os.path.join("run", "*.py")))),
        *data_files,
    ],
)
"""
SETUP_CFG = """\
[options.data_files]
share/demo/gains = resource/*.yaml
share/demo =
    resource/policy.onnx
    %(broken
"""
CMAKE = """\
project(demo)
# install(FILES no.yaml DESTINATION share/demo/gains)
install(DIRECTORY resource/ DESTINATION share/${PROJECT_NAME}/gains)
install(FILES resource/policy.onnx DESTINATION share/${PROJECT_NAME})
install(TARGETS demo DESTINATION lib/${PROJECT_NAME})
"""
FILES = {
    "package.xml": "<package><name>demo</name></package>",
    "config/stack.yaml": "a: 1",
    "extra/more.yaml": "b: 2",
    "models/meshes/arm.stl": "solid",
    "resource/demo": "",
    "resource/gains.yaml": "kp: 1",
    "resource/policy.onnx": "net",
    "run/all.py": "",
}


def write(folder: Path, files: Mapping[str, str]) -> Path:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    write(tmp_path / "ws/src/demo", FILES)
    return tmp_path / "ws"


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def share_of(workspace: Path, monkeypatch: pytest.MonkeyPatch, *prefixes: Path) -> Path:
    """The share folder that a node gets."""
    packages = PackageIndex(workspaces=(workspace,), prefixes=prefixes)
    prefix = make_share_prefix(workspace.parent / "run/prefix", packages)
    variables = with_prefix({"AMENT_PREFIX_PATH": ":".join(map(str, prefixes))}, prefix)
    monkeypatch.setenv("AMENT_PREFIX_PATH", variables["AMENT_PREFIX_PATH"])
    return get_package_share_path("demo")


def test_files_are_found_in_the_source(workspace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    share = share_of(workspace, monkeypatch)
    for name, text in FILES.items():
        assert (share / name).read_text() == text
    (workspace / "src/demo/config/stack.yaml").write_text("a: 2")
    assert (share / "config/stack.yaml").read_text() == "a: 2"


@pytest.mark.parametrize(
    ("name", "text"),
    [("setup.py", SETUP_PY), ("setup.cfg", SETUP_CFG), ("CMakeLists.txt", CMAKE)],
)
def test_files_are_found_by_their_installed_path(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, name: str, text: str
) -> None:
    write(workspace / "src/demo", {name: text})
    share = share_of(workspace, monkeypatch)
    assert (share / "gains/gains.yaml").read_text() == "kp: 1"
    assert (share / "policy.onnx").read_text() == "net"
    assert (share / "models/meshes/arm.stl").is_file()
    assert (share / "config/stack.yaml").is_file()
    if name == "setup.py":
        assert (share / "launch/all.py").is_file()
        assert (share / "config/more.yaml").read_text() == "b: 2"
    assert names_in(workspace / "src/demo/config") == ["stack.yaml"]


def test_files_only_in_the_installed_package_are_found_too(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed = workspace / "install"
    write(
        installed,
        {
            "share/demo/config/stack.yaml": "stale",
            "share/demo/config/generated.yaml": "c: 3",
            "share/demo/cmake/demo.cmake": "",
            "lib/demo/node": "",
        },
    )
    share = share_of(workspace, monkeypatch, installed)
    assert (share / "config/stack.yaml").read_text() == "a: 1"
    assert (share / "config/generated.yaml").read_text() == "c: 3"
    assert (share / "cmake/demo.cmake").is_file()
    assert Path(get_package_prefix("demo"), "lib/demo/node").is_file()


@pytest.mark.parametrize("text", ["def broken(:", "setup(data_files=1)", "\0", "setup(name=3)"])
def test_a_setup_py_without_data_keeps_the_plain_layout(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    write(workspace / "src/demo", {"setup.py": text})
    assert (share_of(workspace, monkeypatch) / "config/stack.yaml").is_file()


def test_no_file_is_linked_outside_the_package_s_own_share(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "setup(data_files=[('share/other', ['package.xml']), ('/etc', ['package.xml']),"
    write(workspace / "src/demo", {"setup.py": f"{text} ('share/demo/../../x', ['package.xml'])])"})
    share = share_of(workspace, monkeypatch)
    assert names_in(share.parent) == ["ament_index", "demo"]
    assert names_in(share.parents[1]) == ["COLCON_IGNORE", "share"]


def test_a_name_that_leads_elsewhere_has_no_share_folder(workspace: Path) -> None:
    write(workspace / "src/bad", {"package.xml": "<package><name>../../bad</name></package>"})
    packages = PackageIndex(workspaces=(workspace,), prefixes=())
    prefix = make_share_prefix(workspace.parent / "run/prefix", packages)
    assert prefix is not None
    assert names_in(prefix.parent) == ["prefix"]
    assert names_in(prefix / "share") == ["ament_index", "demo"]


def test_a_prefix_is_no_folder_of_packages(workspace: Path) -> None:
    packages = PackageIndex(workspaces=(workspace,), prefixes=())
    make_share_prefix(workspace / "runs/prefix", packages)
    assert list(package_folders(workspace)) == [workspace / "src/demo"]


def test_a_workspace_without_packages_needs_no_prefix(tmp_path: Path) -> None:
    packages = PackageIndex(workspaces=(tmp_path,), prefixes=())
    assert make_share_prefix(tmp_path / "prefix", packages) is None
    assert with_prefix({"A": "b"}, None) == {"A": "b"}
    assert not (tmp_path / "prefix").exists()
