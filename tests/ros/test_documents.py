"""Run every command of a page in a real terminal, and compare the output."""

import os
import random
import re
import shlex
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from obelisk_spec.runtime_protocol import USE_SIM_TIME
from obk_cli.compiler import Options, compile_config
from obk_cli.plan.plan import Plan, PlannedNode
from obk_cli.workspace.environment import MachineEnvironment

from ..documents import (  # noqa: TID252 - shared by folders of tests
    PAGES,
    ROOT,
    Commands,
    apply,
    blocks,
    missing_lines,
    page_name,
    steps,
)
from .opengl import require_opengl
from .stack import calm, obk
from .user_shell import DEADLINE_S, UserShell, user_shell

pytestmark = [pytest.mark.ros, pytest.mark.mujoco, pytest.mark.timeout(900)]

ELSEWHERE = {
    "docs/extending.md": "tests/mujoco/test_extending.py",
    "docs/how-to/installing.md": "tests/unit/packaging/test_light_install.py",
    "docs/how-to/rehearsing.md": "tests/ros/test_rehearsal.py",
    "docs/how-to/two-machines.md": "tests/ros/test_devices.py",
    "examples/hardware/README.md": "tests/ros/test_hardware_example.py",
}
"""Pages that need two terminals, two hosts or a copy of the repository -> the test of each."""
SLOW = {
    "docs/how-to/adding-nodes.md",
    "docs/how-to/ci.md",
    "docs/how-to/closed-loop-tests.md",
    "docs/how-to/comparing-runs.md",
    "docs/how-to/doctor.md",
    "docs/how-to/looking-into-a-stack.md",
    "docs/how-to/own-model.md",
    "docs/how-to/own-robot.md",
    "docs/how-to/recording.md",
    "docs/how-to/running.md",
    "docs/how-to/sweeps.md",
    "docs/how-to/viewing.md",
    "examples/arm/README.md",
    "examples/cartpole/README.md",
    "examples/dummy/README.md",
    "examples/quadruped/README.md",
}
"""Pages whose commands other tests run."""
TYPED = ("cd", "cp", "kill", "mkdir", "obk", "python")
"""The programs to run; `make`, `pip` and `apt` would change the machine."""
ACTIVE = re.compile(r"s\] active$", re.MULTILINE)
ALONE = ("lifecycle", "logs", "monitor", "node", "param", "ps", "service", "stop", "topic")
"""Commands for a second terminal, which need a running stack."""
USUAL_PORT = "47001"
NOT_HANDED_OUT = range(61_000, 65_536)
"""Ports that Linux assigns only to programs that request them."""
RECEIVE_ONE = """
import rclpy
from my_msgs.msg import Example

rclpy.init()
node = rclpy.create_node("receiver")
received = []
node.create_subscription(Example, "/my_robot/example", received.append, 10)
stamp = (0, 0)
while stamp == (0, 0):  # simulated time has not begun
    rclpy.spin_once(node)
    if received:
        stamp = (received[-1].header.stamp.sec, received[-1].header.stamp.nanosec)
assert len(received[0].values) == 1
node.destroy_node()
rclpy.shutdown()
"""


def nothing(_: Path) -> None:
    """No preparation and no further check."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """The prerequisites of a page, and checks after its commands."""

    is_calm: bool = True
    is_up: re.Pattern[str] = ACTIVE
    """Text that a launch prints before it is interrupted."""
    prepare: Callable[[Path], None] = nothing
    while_active: Callable[[Path], None] = nothing
    check: Callable[[Path], None] = nothing
    varying: tuple[tuple[str, str], ...] = ()
    """Parts of the page that differ between machines -> their replacements."""


def arm_to_extend(folder: Path) -> None:
    shutil.copytree(ROOT / "examples/arm", folder, dirs_exist_ok=True)


def nodes_were_added(folder: Path) -> None:
    packages = {path.name for path in (folder / "src").iterdir()}
    assert packages == {"arm_py", "balance", "filter", "arm_hardware", "camera"}


def own_packages(folder: Path) -> None:
    shutil.copytree(ROOT / "ros_packages", folder / "src")


def workspace_exists(folder: Path) -> None:
    assert (folder / "my_robot/src/my_controller/package.xml").is_file()
    page = (ROOT / "docs/how-to/scaffolding.md").read_text()
    for made in ("src/my_robot_controller", "src/my_robot_estimator", ".vscode", "model"):
        assert made in page
        assert (folder / "my_robot" / made).is_dir()


def example_is_received(folder: Path) -> None:
    if not (folder / ".obk/overlay").is_dir():
        return
    subprocess.run(
        [sys.executable, "-c", RECEIVE_ONE],
        env={**os.environ, "OBK_OVERLAY_PATH": str(folder / ".obk/overlay")},
        timeout=DEADLINE_S,
        check=True,
    )


def plan_of(config: Path) -> Plan:
    environment = MachineEnvironment(config.parent, config.parent, {})
    options = Options(variables={}, working_folder=config.parent, environment=environment)
    plan = compile_config(str(config), options).plan
    assert plan is not None
    return plan


def variants_differ_in_the_robot(folder: Path) -> None:
    simulated, hardware = (
        plan_of(folder / "my_robot" / f"{name}.yaml") for name in ("my_robot", "hardware")
    )
    (robot,) = (node for node in hardware.nodes if node.section == "robot")
    assert (robot.node, robot.package) == ("obelisk_robot_arm", "my_hardware")
    assert not {"ic_keyframe", "mujoco_setting"} & robot.parameters.keys()
    others = [
        [on_wall_time(n) for n in p.nodes if n.section != "robot"] for p in (simulated, hardware)
    ]
    assert others[0] == others[1]


def on_wall_time(process: PlannedNode) -> PlannedNode:
    """Return the process without the parameter that a simulated stack gives to all of its nodes."""
    parameters = {k: v for k, v in process.parameters.items() if k != USE_SIM_TIME}
    return replace(process, parameters=parameters)


def free_port() -> str:
    """Another test run may use the default port, and the kernel may assign a port twice."""
    for port in random.sample(NOT_HANDED_OUT, 100):
        with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
            line.bind(("127.0.0.1", port))
            return str(port)
    raise AssertionError(f"no port of {NOT_HANDED_OUT} is free")


def plot_is_a_picture(folder: Path) -> None:
    assert (folder / "arm.png").read_bytes().startswith(b"\x89PNG")


SETUPS = {
    "docs/how-to/adding-nodes.md": Setup(prepare=arm_to_extend, check=nodes_were_added),
    "docs/how-to/migrating.md": Setup(prepare=own_packages),
    "docs/how-to/own-robot.md": Setup(is_calm=False, varying=((USUAL_PORT, free_port()),)),
    "docs/how-to/recording.md": Setup(is_calm=False, check=plot_is_a_picture),
    "docs/how-to/scaffolding.md": Setup(check=workspace_exists),
    # The progress line is overwritten.
    "docs/how-to/sweeps.md": Setup(
        varying=(("\ntests/test_arm.py::", "\n...tests/test_arm.py::"),)
    ),
    "docs/how-to/variants.md": Setup(check=variants_differ_in_the_robot),
    "docs/how-to/viewing.md": Setup(
        is_up=re.compile(r"http://127"),
        varying=(
            (":8080/?token=OKPF…", ":..."),
            ("/home/me/arm.mp4, 300 frames, 10.0 s, 0", ".../arm.mp4, ..."),
        ),
    ),
    "docs/tutorial.md": Setup(while_active=example_is_received),
}
"""The pages with their own setup; every other page starts next to the examples."""


def words_of(line: str) -> list[str]:
    """A command line without the variables before it."""
    return re.sub(r"^(\w+=\S* )+", "", line).split()


SHOWING = {
    page_name(page): page for page in PAGES if any(block.kind == "sh" for block in blocks(page))
}


def test_pages_that_other_tests_run_exist_and_so_do_the_tests() -> None:
    assert ELSEWHERE.keys() | SLOW | SETUPS.keys() <= SHOWING.keys()
    for test in ELSEWHERE.values():
        assert (ROOT / test).is_file()


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else [])
        for name in SHOWING
        if name not in ELSEWHERE
    ],
)
def test_the_commands_of_a_page_have_the_shown_output(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    setup = SETUPS.get(name, Setup())
    text = SHOWING[name].read_text()
    if "--render" in text and name in SLOW:
        require_opengl()
    folder = tmp_path / "user"
    for part in ("examples", "schema"):
        shutil.copytree(ROOT / part, folder / part)
    if setup.is_calm:
        calm(folder / "examples" / "dummy")
    setup.prepare(folder)
    page = tmp_path / "page.md"
    page.write_text(text)
    for old, new in setup.varying:
        for path in (page, *(folder / "examples").rglob("*.py")):
            path.write_text(path.read_text().replace(old, new))
    path_variable = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    with user_shell(folder, {**os.environ, "PATH": path_variable}) as shell:
        Walk(page=page, folder=folder, setup=setup, shell=shell).go()
    setup.check(folder)


@dataclass(kw_only=True)
class Walk:
    """A user who follows a page."""

    page: Path
    folder: Path
    setup: Setup
    shell: UserShell
    second_outputs: dict[str, str] = field(default_factory=dict)
    """The output of the commands in the second terminal."""

    def go(self) -> None:
        """Do every step in order."""
        done = steps(self.page)
        lines = [line for step in done if isinstance(step, Commands) for line in step.lines]
        second = [
            line for line in lines if words_of(line)[:1] == ["obk"] and is_for_second_terminal(line)
        ]
        if second and not any(line.startswith("obk launch") for line in lines):
            self.enter("obk launch examples/dummy/dummy.yaml", second)
        for step in done:
            if not isinstance(step, Commands):
                apply(step, self.folder)
                continue
            seen = ""
            for line in step.lines:
                if words_of(line)[0] not in TYPED:
                    continue
                if is_for_second_terminal(line):
                    seen += self.second_outputs[line]
                    continue
                code = self.enter(line, second)
                is_last = line == step.lines[-1]
                assert code == int(is_last and step.finds_errors), (line, self.shell.seen)
                seen += self.shell.seen
            assert not missing_lines(step.shown, seen), seen

    def enter(self, line: str, second: list[str]) -> int:
        """Type a command; interrupt a launch that does not end by itself. Return the exit code."""
        if line.startswith("cd "):
            self.folder /= line.removeprefix("cd ")
        self.shell.enter(line)
        if line.startswith("obk launch") and "--duration" not in line and "||" not in line:
            self.shell.wait_for(self.setup.is_up)
            self.setup.while_active(self.folder)
            for other in second:
                self.type_elsewhere(other)
            if not any(other.startswith("obk stop") for other in second):
                self.shell.press_ctrl_c()
        return self.shell.wait_for_prompt()

    def type_elsewhere(self, line: str) -> None:
        """Run a command in a second terminal."""
        done = obk(*shlex.split(line)[1:], folder=self.folder)
        assert done.returncode == 0, (line, done.stdout, done.stderr)
        self.second_outputs[line] = done.stdout


def is_for_second_terminal(line: str) -> bool:
    """Whether a command is for a second terminal."""
    return words_of(line)[1:2] != [] and words_of(line)[1] in ALONE
