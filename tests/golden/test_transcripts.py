"""What the commands print, word for word: one transcript a command. `make golden` rewrites them.

The help of all commands is in `docs/reference/commands.md`, which a test keeps up to date.
"""

import json
import os
import re
import shutil
import struct
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest

from obk_cli.cli.commands import VERBS
from obk_cli.process.identity import this_process
from obk_cli.record.mcap_writer import BagWriter

from ..turns import turn_of_leftovers  # noqa: TID252 - shared by folders of tests
from ..unit.obk_cli.runs.fake_stack import CONTROL, JOY, ROBOT, fake_stack  # noqa: TID252

HERE = Path(__file__).parent
TRANSCRIPTS = HERE / "transcripts"
RUN = r"""
import importlib, os, sys
from obk_cli.cli.commands import VERBS
from obk_cli.cli.main import main
for command in sys.argv[1:]:
    importlib.import_module(VERBS[command.split()[0]].module)
for command in sys.argv[1:]:
    if not (pid := os.fork()):
        main(command.split())
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    for stream in (1, 2):
        os.write(stream, f"\0{code}\0".encode())
"""
"""Each command in a process of its own; what they import is imported once."""
SEEING = """
import os, psutil
from obk_cli.runs import orphans
seen = map(int, os.environ["SEEN"].split())
seen = [psutil.Process(pid) for pid in seen if psutil.pid_exists(pid)]
orphans._own_processes = lambda: seen
"""
"""Orphans of other stacks on this machine are neither shown nor ended."""
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
    "stop": ("stop", "stop dummy --all"),
    "sweep": (
        "sweep missing.yaml",
        f"sweep {DUMMY} --vary onboard.robt[0].is_simulated=true,false",
        f"sweep {DUMMY} --vary onboard.control[0].timers[0].timer_period_sec=0.001",
        f"sweep {DUMMY} --vary onboard.control[0].timers[0].timer_period_sec=0..1",
        f"sweep {DUMMY} --engine ray",
    ),
    "logs": ("logs", "logs dummy"),
    # Not all checks: what they find depends on the machine.
    "doctor": ("doctor --list", "doctor workspce", "doctor folders workspace"),
}
OF_RUNS = {"ps": ("ps",), "reap": ("reap --dry-run", "reap", "reap")}
OF_ROS = {
    "lifecycle": ("lifecycle get", "lifecycle activate"),
    "topic": ("topic list", "topic info /ctrl", "topic echo /ctrl", "topic hz /ctrl"),
    "node": ("node list", "node info control"),
    "param": ("param list control", "param get control amplitude"),
    "service": ("service list", "service call /reset"),
}


CLOSED_LOOP = """\
def test_the_rod_stands_a_push(stack, seed):
    rod = stack(seed=seed)
    rod.push("link1", [30.0, 0.0, 0.0], duration=0.1)
    run = rod.run(0.3)
    estimates = run["/obelisk/dummy/est"]
    assert len(estimates) >= 300 - seed
"""
OF_TESTS = {
    "test": (
        f"test {DUMMY} test_rod.py --seeds 2",
        "test broken.yaml",
        f"test {DUMMY} --seeds none",
        f"test {DUMMY} --again test_x.py::test_push[seed17]",
    )
}


OF_RECORDINGS = {
    "diff": ("diff before.mcap after.mcap", "diff before.mcap none"),
    "export": (
        "export after.mcap --to csv --output tables",
        "export before.mcap --to xlsx",
        "export before.mcap --to csv --topic ets",
    ),
    "plot": (
        "plot before.mcap est",
        "plot before.mcap est.q_jonts",
        "plot before.mcap est.q_joints --xlim 2 1",
        "plot before.mcap est.q_joints --output joints.gif",
    ),
    "play": (
        "play before.mcap --topic ctrl",
        "play before.mcap --nodes control",
        f"play before.mcap --into {DUMMY} --nodes estimtion",
        f"play before.mcap --into {DUMMY} --nodes estimation",
    ),
}
ESTIMATE = "# Joint positions [rad].\nfloat64[] q_joints\nstring[] joint_names\n"


def write_run(path: Path, gain: float) -> None:
    """An estimate of two joints at 100 Hz for a second, and a command."""
    process = {"node": "control", "section": "control", "parameters": {"kp": gain}}
    with BagWriter(path) as writer:
        plan = json.dumps({"name": "arm", "processes": [process]})
        versions = {"obk": "0.1.0", "python": "3.11.7"}
        writer.describe({"obelisk_versions": versions}, {"plan.json": plan}, 0)
        estimates = writer.add_topic("/arm/est", "demo_msgs/msg/Estimate", ESTIMATE, {})
        commands = writer.add_topic(
            "/arm/ctrl", "obelisk_control_msgs/msg/PositionSetpoint", "float64 u\n", {}
        )
        names = struct.pack("<I4sI5s", 4, b"hip", 5, b"knee")
        for number in range(101):
            time_ns = 1_000_000_000 + number * 10_000_000
            data = struct.pack("<I4xddI", 2, number / 100, number / gain, 2) + names
            writer.add_message(estimates, b"\0\1\0\0" + data, time_ns, time_ns, number)
        data = b"\0\1\0\0" + struct.pack("<d", gain)
        writer.add_message(commands, data, time_ns, time_ns, number)


def transcript(
    commands: tuple[str, ...],
    folder: Path,
    repository: Path,
    *,
    seen: Mapping[int, str] | None = None,
) -> str:
    """The commands, one after another in a folder, with what they printed and their exit codes.

    `seen`: the processes that are found, and what stands for their numbers; None: all.
    """
    (folder / "broken.yaml").write_text(BROKEN)
    (folder / "warning.yaml").write_text(WARNING)
    shutil.copytree(
        repository / "examples" / "dummy", folder / "examples" / "dummy", dirs_exist_ok=True
    )
    environment = {
        **{key: value for key, value in os.environ.items() if not key.startswith("COV")},
        "HOME": str(folder),
        "OBK_HOME": str(folder / ".obk_home"),
        "XDG_CONFIG_HOME": str(folder / ".config"),
        "XDG_CACHE_HOME": str(folder / ".cache"),
        "TMPDIR": str(folder),
        "COLUMNS": "100",
        "NO_COLOR": "1",
        "SEEN": " ".join(map(str, seen or ())),
    }
    done = subprocess.run(
        [sys.executable, "-c", RUN if seen is None else SEEING + RUN, *commands],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    outs, errors = (text.split("\0") for text in (done.stdout, done.stderr))
    parts = []
    for command, out, error, code in zip(
        commands, outs[:-1:2], errors[:-1:2], outs[1::2], strict=True
    ):
        printed = f"{out}{error}".replace(str(folder), "<folder>")
        printed = printed.replace(sys.prefix, "<prefix>").replace(str(repository), "<repository>")
        printed = re.sub(r"ROS domain \d+", "ROS domain <domain>", printed)
        printed = re.sub(r"[\d.]+ [KMGT]iB free", "<size> free", printed)
        for pid, name in (seen or {}).items():
            printed = re.sub(rf"\b{pid}\b", name, printed)
        parts.append(f"$ obk {command}\n{printed}[exit code {code}]\n")
    return "\n".join(parts)


@pytest.mark.parametrize(
    "name",
    [*COMMANDS, *(pytest.param(name, marks=pytest.mark.ros) for name in OF_ROS)],
)
def test_a_command_prints_its_transcript(
    name: str, tmp_path: Path, repository: Path, request: pytest.FixtureRequest
) -> None:
    text = transcript((COMMANDS | OF_ROS)[name], tmp_path, repository)
    compare(name, text, request.config.getoption("--update-golden"))


def test_ps_prints_its_transcript(
    tmp_path: Path, repository: Path, request: pytest.FixtureRequest
) -> None:
    states = {ROBOT: "active", CONTROL: "inactive", JOY: ""}
    nothing = transcript(OF_RUNS["ps"], tmp_path, repository, seen={})
    runs = tmp_path / ".obk_home" / "runs"
    with fake_stack(runs, states, devices=("onboard",)) as stack, orphan() as seen:
        stack.hung.add(ROBOT)
        running = transcript(OF_RUNS["ps"], tmp_path, repository, seen=seen)
        (stack.folder / "control.sock").unlink()
        silent = transcript(OF_RUNS["ps"], tmp_path, repository, seen=seen)
    # The launcher's time is fixed; without its answer the process's own age is shown.
    silent = re.sub(r"up [\d:]+", "up <time>", silent)
    text = "\n".join((nothing, running, silent))
    compare("ps", text, request.config.getoption("--update-golden"))


def test_reap_prints_its_transcript(
    tmp_path: Path, repository: Path, request: pytest.FixtureRequest
) -> None:
    with orphan() as seen:
        text = transcript(OF_RUNS["reap"], tmp_path, repository, seen=seen)
    compare("reap", text, request.config.getoption("--update-golden"))


@pytest.mark.parametrize("name", OF_RECORDINGS)
def test_a_command_about_recordings_prints_its_transcript(
    name: str, tmp_path: Path, repository: Path, request: pytest.FixtureRequest
) -> None:
    write_run(tmp_path / "before.mcap", 20.0)
    write_run(tmp_path / "after.mcap", 25.0)
    text = transcript(OF_RECORDINGS[name], tmp_path, repository)
    compare(name, text, request.config.getoption("--update-golden"))


@pytest.mark.ros
@pytest.mark.mujoco
def test_test_prints_its_transcript(
    tmp_path: Path, repository: Path, request: pytest.FixtureRequest
) -> None:
    (tmp_path / "test_rod.py").write_text(CLOSED_LOOP)
    text = transcript(OF_TESTS["test"], tmp_path, repository)
    text = re.sub(r"\b\d+\.\d+ ?(s\b|x\b)(?! simulated)", r"<number> \1", text)
    compare("test", text, request.config.getoption("--update-golden"))


@contextmanager
def orphan() -> Iterator[Mapping[int, str]]:
    """A process whose launcher is gone."""
    launcher, started = this_process()
    sleep = shutil.which("sleep")
    assert sleep
    with (
        turn_of_leftovers(),
        subprocess.Popen(
            ["sleep", "1000"],
            executable=sleep,
            env={"OBK_RUN": "dummy_20310203_040506", "OBK_LAUNCHER": f"{launcher}:{started - 60}"},
            start_new_session=True,
        ) as process,
    ):
        try:
            yield {process.pid: "<pid>", launcher: "<launcher>"}
        finally:
            process.kill()


def compare(name: str, text: str, is_update: bool) -> None:
    expected = TRANSCRIPTS / f"{name}.txt"
    if is_update:
        expected.parent.mkdir(exist_ok=True)
        expected.write_text(text, encoding="utf-8")
    assert text == expected.read_text(encoding="utf-8")


def test_every_transcript_is_of_a_command() -> None:
    names = {path.stem for path in TRANSCRIPTS.glob("*.txt")}
    tables = (COMMANDS, OF_ROS, OF_RUNS, OF_TESTS, OF_RECORDINGS)
    assert names == {name for table in tables for name in table}
    assert names <= VERBS.keys()
