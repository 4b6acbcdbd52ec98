"""A new user's first stack, as `docs/tutorial.md` has it, at a real terminal."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from .user_shell import DEADLINE_S, user_shell
from .walkthrough import Commands, apply, missing_lines, steps

pytestmark = pytest.mark.ros

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "tutorial.md"
ACTIVE = re.compile(r"s\] active$", re.MULTILINE)
HEAR_ONE = """
import rclpy
from my_msgs.msg import Example

rclpy.init()
node = rclpy.create_node("listener")
heard = []
node.create_subscription(Example, "/my_robot/example", heard.append, 10)
while not heard:
    rclpy.spin_once(node)
print(len(heard[0].values), heard[0].header.stamp.sec > 0)
node.destroy_node()
rclpy.shutdown()
"""


@pytest.mark.timeout(600)
def test_the_first_stack_goes_as_the_tutorial_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    heard = []
    with user_shell(tmp_path, {**os.environ, "PATH": path}) as shell:
        for step in steps(DOCUMENT):
            workspace = tmp_path / "my_robot"
            if not isinstance(step, Commands):
                apply(step, workspace)
                continue
            seen = ""
            for line in step.lines:
                is_last = line == step.lines[-1]
                shell.enter(line)
                if line.startswith("obk launch"):
                    shell.wait_for(ACTIVE)
                    if (workspace / ".obk" / "overlay").is_dir():
                        heard.append(hear_one(workspace))
                    shell.press_ctrl_c()
                code = shell.wait_for_prompt()
                assert code == int(is_last and step.finds_errors), (line, shell.seen)
                seen += shell.seen
            assert not missing_lines(step.shown, seen), seen
    assert heard == ["1 True\n"]


def hear_one(workspace: Path) -> str:
    """What another program hears of the controller's own message."""
    listening = subprocess.run(
        [sys.executable, "-c", HEAR_ONE],
        env={**os.environ, "OBK_OVERLAY_PATH": str(workspace / ".obk" / "overlay")},
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        check=False,
    )
    assert listening.returncode == 0, listening.stderr
    return listening.stdout
