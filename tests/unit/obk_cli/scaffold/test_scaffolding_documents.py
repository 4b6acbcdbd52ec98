"""The commands of the pages on scaffolding and on adding nodes make what the pages say.

What they launch is the workspace of `obk init`, which the tutorial's test launches.
"""

import os
import re
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from obk_cli.cli.commands import root_command

from ....ros.walkthrough import (  # noqa: TID252 - shared by folders of tests
    Commands,
    missing_lines,
    steps,
)

ROOT = Path(__file__).resolve().parents[4]
SCAFFOLDING = ROOT / "docs" / "how-to" / "scaffolding.md"
ADDING_NODES = ROOT / "docs" / "how-to" / "adding-nodes.md"
CI = ROOT / "docs" / "how-to" / "ci.md"
"""Its listings that begin inside a file are those of `obk init`, in this order."""
OF_INIT = (".github/workflows/check.yaml", ".pre-commit-config.yaml")

pytestmark = pytest.mark.mujoco


def type_all(document: Path) -> None:
    for step in steps(document):
        assert isinstance(step, Commands)
        seen = ""
        for line in step.lines:
            program, *arguments = line.split()
            if program == "cd":
                os.chdir(arguments[0])
            elif arguments[0] != "launch":
                result = CliRunner().invoke(root_command(), arguments, catch_exceptions=False)
                assert result.exit_code == 0, result.output
                seen += result.output
        assert not missing_lines(step.shown, seen), seen


def test_a_workspace_and_a_node_are_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    type_all(SCAFFOLDING)
    assert (tmp_path / "my_robot/src/my_controller/package.xml").is_file()
    page = SCAFFOLDING.read_text()
    for made in ("src/my_robot_controller", "src/my_robot_estimator", ".vscode", "model"):
        assert made in page
        assert (tmp_path / "my_robot" / made).is_dir()
    listings = re.findall(r"```yaml\n( .*?)```", CI.read_text(), re.DOTALL)
    for file, listing in zip(OF_INIT, listings, strict=True):
        assert listing in (tmp_path / "my_robot" / file).read_text()


def test_nodes_go_into_a_config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copy = tmp_path / "arm"
    shutil.copytree(ROOT / "examples/arm", copy)
    there = {folder.name for folder in (copy / "src").iterdir()}
    monkeypatch.chdir(copy)
    type_all(ADDING_NODES)
    made = {folder.name for folder in (copy / "src").iterdir()} - there
    assert made == {"balance", "filter", "arm_hardware", "camera"}
