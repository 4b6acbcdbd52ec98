"""The CI workflow of a new workspace, run step by step in an empty environment."""

import os
import subprocess
import venv
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from obk_cli.cli.commands import root_command

pytestmark = [pytest.mark.ros, pytest.mark.mujoco, pytest.mark.slow, pytest.mark.timeout(1500)]

KEPT = ("HOME", "LANG", "PATH", "PIP_CONFIG_FILE", "PIP_INDEX_URL", "PIP_EXTRA_INDEX_URL")
"""Variables of this process that a runner also has, for example for pip's index."""


def test_every_step_of_a_new_workspace_succeeds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    made = CliRunner().invoke(root_command(), ["init", "my_robot"], catch_exceptions=False)
    assert made.exit_code == 0, made.output
    workflow = tmp_path / "my_robot" / ".github" / "workflows" / "check.yaml"
    steps = yaml.safe_load(workflow.read_text())["jobs"]["check"]["steps"]
    commands = [step["run"] for step in steps if "run" in step]
    assert commands[0].startswith("pip install ")
    venv.create(tmp_path / "environment", with_pip=True)
    environment = {name: os.environ[name] for name in KEPT if name in os.environ}
    environment["PATH"] = f"{tmp_path / 'environment' / 'bin'}:{environment['PATH']}"
    environment["OBK_HOME"] = str(tmp_path / "home")
    environment["ROS_DOMAIN_ID"] = os.environ["ROS_DOMAIN_ID"]
    for command in commands:
        done = subprocess.run(
            ["bash", "-e", "-o", "pipefail", "-c", command],
            cwd=tmp_path / "my_robot",
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{command}\n{done.stdout}"
