"""docs/how-to/two-machines.md: its edit gives the dummy's controller a device of its own."""

import shutil
from pathlib import Path

import pytest

from obk_cli.compiler import Options, compile_config
from obk_cli.workspace.environment import MachineEnvironment

from ...ros.walkthrough import (  # noqa: TID252 - shared by folders of tests
    Commands,
    apply,
    steps,
)

ROOT = Path(__file__).parents[3]
DOCUMENT = ROOT / "docs/how-to/two-machines.md"


@pytest.mark.mujoco
def test_each_launch_of_the_document_has_its_nodes(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "examples/dummy", tmp_path / "two")
    typed: list[str] = []
    for step in steps(DOCUMENT):
        if isinstance(step, Commands):
            typed += step.lines
        else:
            apply(step, tmp_path / "two")
    folder = tmp_path / "two"
    options = Options(
        variables={}, working_folder=folder, environment=MachineEnvironment(folder, folder, {})
    )
    plan = compile_config(str(folder / "dummy_new.yaml"), options).plan
    assert plan is not None
    devices = {process.node: process.device for process in plan.processes}
    assert devices == {
        "obelisk_robot_0": "onboard",
        "obelisk_estimation_0": "onboard",
        "obelisk_control_0": "offboard",
    }
    launches = [f"obk launch dummy_new.yaml --device {name}" for name in ("onboard", "offboard")]
    assert typed[-2:] == launches
