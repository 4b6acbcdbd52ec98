"""What the commands print, word for word: one transcript a command. `make golden` rewrites them.

The help of all commands is in `docs/reference/commands.md`, which a test keeps up to date.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
TRANSCRIPTS = HERE / "transcripts"
RUN = "from obk_cli.cli.main import main; main()"
BROKEN = """\
config: broken
control:
  pkg: obelisk_control_py
  executable: example_position_setpoint_controller
  publishers:
    - {key: pub_ctrl, topic: /ctrl, msg_type: PositionSetpiont}
  timers:
    - {key: timer_ctrl, timer_period_sec: fast}
"""
WARNING = """\
config: warning
control:
  pkg: obelisk_control_py
  executable: example_position_setpoint_controller
  publishers:
    - {key: pub_ctrl, topic: /ctrl, msg_type: PositionSetpoint}
  subscribers:
    - {key: sub_est, topic: /est, msg_type: EstimatedState}
  timers:
    - {key: timer_ctrl, timer_period_sec: 0.001}
"""
DUMMY = "examples/dummy/dummy.yaml"
COMMANDS = {
    "validate": (
        f"validate {DUMMY}",
        "validate broken.yaml",
        "validate warning.yaml",
        "validate missing.yaml",
    ),
    "compile": (f"compile {DUMMY} --to params", "compile broken.yaml"),
    "graph": (f"graph {DUMMY}",),
    "explain": ("explain OBK101", "explain OBK405", "explain OBK203", "explain OBK999"),
    "migrate": (f"migrate {DUMMY}", "migrate broken.yaml"),
    "init": ("init my_robot", "init my_robot", "init My-Robot"),
    "new": (
        "new controller my_ctrl",
        "new msgs my_msgs",
        "new controller class",
    ),
    # Not `ps` and `reap`: they see what other stacks have left on this machine.
    "runs": ("stop", "logs"),
}
OF_ROS = {
    "lifecycle": ("lifecycle get", "lifecycle activate"),
    "topic": ("topic list", "topic info /ctrl", "topic echo /ctrl", "topic hz /ctrl"),
    "node": ("node list", "node info control"),
    "param": ("param list control", "param get control amplitude"),
    "service": ("service list", "service call /reset"),
}


def transcript(commands: tuple[str, ...], folder: Path, repository: Path) -> str:
    """The commands, one after another in a folder, with what they printed and their exit codes."""
    (folder / "broken.yaml").write_text(BROKEN)
    (folder / "warning.yaml").write_text(WARNING)
    shutil.copytree(repository / "examples" / "dummy", folder / "examples" / "dummy")
    environment = {
        **{key: value for key, value in os.environ.items() if not key.startswith("COV")},
        "HOME": str(folder),
        "OBK_HOME": str(folder / ".obk_home"),
        "XDG_CONFIG_HOME": str(folder / ".config"),
        "COLUMNS": "100",
        "NO_COLOR": "1",
    }
    parts = []
    for command in commands:
        done = subprocess.run(
            [sys.executable, "-c", RUN, *command.split()],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        printed = f"{done.stdout}{done.stderr}".replace(str(folder), "<folder>")
        printed = printed.replace(sys.prefix, "<prefix>").replace(str(repository), "<repository>")
        printed = re.sub(r"ROS domain \d+", "ROS domain <domain>", printed)
        parts.append(f"$ obk {command}\n{printed}[exit code {done.returncode}]\n")
    return "\n".join(parts)


@pytest.mark.parametrize(
    "name",
    [*COMMANDS, *(pytest.param(name, marks=pytest.mark.ros) for name in OF_ROS)],
)
def test_a_command_prints_its_transcript(
    name: str, tmp_path: Path, repository: Path, request: pytest.FixtureRequest
) -> None:
    text = transcript((COMMANDS | OF_ROS)[name], tmp_path, repository)
    expected = TRANSCRIPTS / f"{name}.txt"
    if request.config.getoption("--update-golden"):
        expected.parent.mkdir(exist_ok=True)
        expected.write_text(text, encoding="utf-8")
    assert text == expected.read_text(encoding="utf-8")


def test_every_transcript_is_of_a_command() -> None:
    assert {path.stem for path in TRANSCRIPTS.glob("*.txt")} == COMMANDS.keys() | OF_ROS.keys()
