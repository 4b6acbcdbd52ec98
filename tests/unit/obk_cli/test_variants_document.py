"""docs/how-to/variants.md, typed in a shell: its variants are what the page says."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from obk_cli.compiler import Options, compile_config
from obk_cli.plan.plan import Plan
from obk_cli.workspace.environment import MachineEnvironment

from ...ros.walkthrough import (  # noqa: TID252 - shared by folders of tests
    Commands,
    apply,
    missing_lines,
    steps,
)

DOCUMENT = Path(__file__).parents[3] / "docs/how-to/variants.md"
LISTING = re.compile(r"as `hardware\.yaml`:\n\n```yaml\n(.*?)```", re.DOTALL)
VARS = re.compile(r"```yaml\n(vars:.*?)```", re.DOTALL)

pytestmark = pytest.mark.mujoco


def typed(line: str, folder: Path) -> str:
    """What a line shows that has to be done without an error."""
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", line],
        cwd=folder,
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, (line, done.stdout, done.stderr)
    return done.stdout + done.stderr


def plan_of(config: Path) -> Plan:
    environment = MachineEnvironment(config.parent, config.parent, {})
    options = Options(variables={}, working_folder=config.parent, environment=environment)
    plan = compile_config(str(config), options).plan
    assert plan is not None
    return plan


def test_the_variants_of_the_document_differ_as_it_says(tmp_path: Path) -> None:
    folder = tmp_path
    (listing,) = LISTING.findall(DOCUMENT.read_text())
    for step in steps(DOCUMENT):
        if not isinstance(step, Commands):
            apply(step, folder)
            (folder / "hardware.yaml").write_text(listing)
            continue
        seen = ""
        for line in step.lines:
            if line.startswith("cd "):
                folder = folder / line.removeprefix("cd ")
            else:
                seen += typed(line, folder)
        assert not missing_lines(step.shown, seen), seen
    simulated, hardware = (plan_of(folder / f"{name}.yaml") for name in ("my_robot", "hardware"))
    (robot,) = (node for node in hardware.processes if node.section == "robot")
    assert (robot.node, robot.package) == ("obelisk_robot_arm", "my_hardware")
    assert not {"ic_keyframe", "mujoco_setting"} & robot.parameters.keys()
    others = [[n for n in p.processes if n.section != "robot"] for p in (simulated, hardware)]
    assert others[0] == others[1]


def test_a_period_may_stand_in_vars(tmp_path: Path) -> None:
    typed("obk init my_robot", tmp_path)
    config = tmp_path / "my_robot" / "my_robot.yaml"
    before = plan_of(config)
    (listing,) = VARS.findall(DOCUMENT.read_text())
    text = config.read_text()
    assert "timer_period_sec: 0.002" in text
    config.write_text(listing + text.replace("sec: 0.002", "sec: *period"))
    after = plan_of(config)
    assert [p.parameters for p in after.processes] == [p.parameters for p in before.processes]
