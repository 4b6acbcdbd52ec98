"""The source file of an executable, in any package layout."""

import sys
from pathlib import Path

import pytest

from obk_cli.config.environment import CodeFault, NodeCode, NodeFacts
from obk_cli.workspace.environment import MachineEnvironment

NODE = """\
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.utils.ros import spin_obelisk

raise SystemExit("this source was run")


class Mine(ObeliskNode):
    def __init__(self):
        super().__init__("mine")
        self.register_obk_publisher("pub_x_setting")


def main():
    spin_obelisk(None, Mine)
"""
SETUP = "setup(entry_points={'console_scripts': ['run = demo.run:main']})"


def package(root: Path, setup: str = SETUP) -> Path:
    root.mkdir(parents=True)
    (root / "package.xml").write_text("<package><name>demo</name></package>")
    (root / "setup.py").write_text(setup)
    return root


def read(workspace: Path) -> NodeCode | None:
    return MachineEnvironment(workspace, workspace, {}).read_node_code("demo", "run")


@pytest.mark.parametrize("layout", [".", "src"])
def test_an_entry_point_in_the_workspace_is_read_and_not_run(tmp_path: Path, layout: str) -> None:
    root = package(tmp_path / "src" / "demo")
    folder = root / layout / "demo"
    folder.mkdir(parents=True)
    (folder / "run.py").write_text(NODE)
    found = read(tmp_path)
    assert isinstance(found, NodeFacts)
    assert [component.name for component in found.components] == ["pub_x_setting"]
    assert found.knows_components
    assert found.span.path == str((folder / "run.py").relative_to(tmp_path))
    assert "demo" not in sys.modules


def test_a_base_in_another_package_of_the_workspace_is_followed(tmp_path: Path) -> None:
    folder = package(tmp_path / "src" / "demo") / "demo"
    folder.mkdir()
    text = "from base.run import main, Mine\n"
    (folder / "run.py").write_text(text)
    base = tmp_path / "src" / "base"
    (base / "base").mkdir(parents=True)
    (base / "package.xml").write_text("<package><name>base</name></package>")
    (base / "base" / "run.py").write_text(NODE)
    assert isinstance(read(tmp_path), NodeFacts)


def test_a_python_script_of_the_package_is_read(tmp_path: Path) -> None:
    scripts = package(tmp_path / "src" / "demo", "setup()") / "scripts"
    scripts.mkdir()
    (scripts / "run").write_text(f"#!/usr/bin/env python3\n{NODE}\nmain()\n")
    (scripts / "run").chmod(0o755)
    found = read(tmp_path)
    assert isinstance(found, NodeFacts)
    assert found.class_name == "Mine"


def test_a_shell_script_that_runs_a_module_leads_to_it(tmp_path: Path) -> None:
    scripts = package(tmp_path / "src" / "demo", "setup()") / "scripts"
    scripts.mkdir()
    runs = 'exec "$prefix/bin/python" -P -m obelisk_py.zoo.estimation "$@"\n'
    (scripts / "run").write_text(f"#!/bin/sh\n{runs}")
    (scripts / "run").chmod(0o755)
    found = read(tmp_path)
    assert isinstance(found, NodeFacts)
    assert found.class_name == "TypedEstimator"


@pytest.mark.parametrize("content", [b"\x7fELF\x00\x01", b"#!/bin/sh\nexec ./other\n"])
def test_a_program_that_is_not_python_reports_nothing(tmp_path: Path, content: bytes) -> None:
    scripts = package(tmp_path / "src" / "demo", "setup()") / "scripts"
    scripts.mkdir()
    (scripts / "run").write_bytes(content)
    (scripts / "run").chmod(0o755)
    assert read(tmp_path) is None


def test_a_package_elsewhere_reports_nothing(tmp_path: Path) -> None:
    package(tmp_path / "src" / "demo")
    assert read(tmp_path) is None


def test_a_module_that_is_not_in_its_package_is_a_fault(tmp_path: Path) -> None:
    (package(tmp_path / "src" / "demo") / "demo").mkdir()
    found = read(tmp_path)
    assert isinstance(found, CodeFault)
    assert found.place == str(tmp_path / "src" / "demo" / "demo" / "run.py")


def test_a_file_with_a_declared_encoding_is_read(tmp_path: Path) -> None:
    folder = package(tmp_path / "src" / "demo") / "demo"
    folder.mkdir()
    (folder / "run.py").write_bytes(f"# -*- coding: latin-1 -*-\n# é\n{NODE}".encode("latin-1"))
    assert isinstance(read(tmp_path), NodeFacts)
    (folder / "run.py").write_bytes(f"# é\n{NODE}".encode("latin-1"))
    assert read(tmp_path) is None


@pytest.mark.parametrize(
    ("module", "made", "is_found"),
    [
        ("demo.gone", None, True),
        ("nowhere_at_all", None, True),
        ("demo.fast", "demo/demo/fast.cpython-311-x86_64-linux-gnu.so", False),
        ("demo.folder", "demo/demo/folder/data.txt", False),
        ("demo.built", "demo/CMakeLists.txt", False),
        ("my_msgs.msg", "my_msgs/package.xml", False),
        ("other.gone", "other/other/__init__.py", True),
        ("yaml.anything", None, False),
        ("json.anything", None, False),
    ],
)
def test_an_import_fails_only_if_nothing_can_provide_it(
    module: str, made: str | None, is_found: bool, tmp_path: Path
) -> None:
    folder = package(tmp_path / "src" / "demo") / "demo"
    folder.mkdir()
    (folder / "run.py").write_text(f"import {module}\n{NODE}")
    if made is not None:
        file = tmp_path / "src" / made
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("<package><name>my_msgs</name></package>")
        manifest = tmp_path / "src" / made.partition("/")[0] / "package.xml"
        if not manifest.exists():
            manifest.write_text(f"<package><name>{manifest.parent.name}</name></package>")
    found = read(tmp_path)
    assert isinstance(found, NodeFacts)
    assert [finding.code for finding in found.findings] == (["OBK421"] if is_found else [])
