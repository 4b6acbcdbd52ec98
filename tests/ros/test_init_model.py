"""The closed-loop tests of workspaces for robot models pass."""

import subprocess
from pathlib import Path

import pytest

from ..robot_models import CART, MIXED  # noqa: TID252 - shared by folders of tests
from ..waiting import DEADLINE_S  # noqa: TID252 - shared by folders of tests
from .stack import OBK

pytestmark = [pytest.mark.ros, pytest.mark.mujoco]


@pytest.mark.parametrize(
    "model",
    [pytest.param(CART, id="torques", marks=pytest.mark.slow), pytest.param(MIXED, id="servos")],
)
def test_the_closed_loop_test_of_a_new_workspace_passes(tmp_path: Path, model: str) -> None:
    (tmp_path / "given.xml").write_text(model)
    for arguments in (
        ("init", "robot", "--model", "given.xml"),
        ("test", "robot/robot.yaml"),
        ("test", "robot/robot.yaml", "robot/src"),
    ):
        done = subprocess.run(
            [OBK, *arguments],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=DEADLINE_S,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
