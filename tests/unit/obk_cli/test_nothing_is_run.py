"""Checking executes nothing: a workspace full of traps, and every command that only reads it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

OBK = Path(sys.executable).with_name("obk")
TRAP = "import os\nos.close(os.open(os.environ['SPRUNG'], os.O_CREAT | os.O_WRONLY))\n"
SETUP = f"{TRAP}setup(entry_points={{'console_scripts': ['run = demo.run:main']}})\n"
NODE = f"""\
{TRAP}
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.utils.ros import spin_obelisk


class Mine(ObeliskNode):
    def __init__(self):
        super().__init__("mine")
        self.register_obk_publisher("pub_x_setting")


def main():
    spin_obelisk(None, Mine)
"""
CONFIG = """\
config: trapped
estimation:
  pkg: demo
  executable: run
  publishers:
    - {key: pub_x, topic: /x, msg_type: EstimatedState, ros_parameter: pub_x_setting}
"""
SHADOWS = ("rclpy", "mujoco", "numpy", "yaml", "typer", "json", "sitecustomize", "conftest")
"""Modules that Python would import from the working folder, if it searched there."""


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    folder = tmp_path / "ws"
    package = folder / "src" / "demo" / "demo"
    package.mkdir(parents=True)
    (package.parent / "package.xml").write_text("<package><name>demo</name></package>")
    (package.parent / "setup.py").write_text(SETUP)
    (package / "__init__.py").write_text(TRAP)
    (package / "run.py").write_text(NODE)
    for name in SHADOWS:
        (folder / f"{name}.py").write_text(TRAP)
    (folder / "trapped.yaml").write_text(CONFIG)
    return folder


@pytest.mark.parametrize(
    "words",
    [
        ["validate", "trapped.yaml", "--ignore", "OBK"],
        ["validate", "trapped.yaml", "--for-test", "--ignore", "OBK"],
        ["compile", "trapped.yaml", "--ignore", "OBK"],
        ["graph", "trapped.yaml", "--ignore", "OBK"],
        ["migrate", "trapped.yaml"],
        ["explain", "OBK203"],
        ["schema", "--install-vscode"],
    ],
    ids=lambda words: words[0],
)
def test_a_command_that_only_reads_runs_nothing_of_a_workspace(
    workspace: Path, tmp_path: Path, words: list[str]
) -> None:
    sprung = tmp_path / "sprung"
    done = subprocess.run(
        [OBK, *words],
        cwd=workspace,
        env={**os.environ, "SPRUNG": str(sprung)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode in (0, 1), done.stderr
    assert "Traceback" not in done.stderr
    assert not sprung.exists(), words
    assert list(workspace.rglob("__pycache__")) == []


@pytest.mark.parametrize("code", ["import conftest", "import demo.run"])
def test_the_traps_trigger_if_something_is_run(workspace: Path, tmp_path: Path, code: str) -> None:
    sprung = tmp_path / "sprung"
    path = os.pathsep.join((str(workspace), str(workspace / "src" / "demo")))
    subprocess.run(
        [sys.executable, "-S", "-c", code],
        env={**os.environ, "SPRUNG": str(sprung), "PYTHONPATH": path},
        stderr=subprocess.DEVNULL,
        timeout=120,
        check=False,
    )
    assert sprung.exists()
