"""Transcripts of all commands, one per command. `make golden` rewrites them.

The help of all commands is in `docs/reference/commands.md`, which a test keeps up to date.
"""

import json
import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest

from obelisk_recordings.bag import DROPS
from obk_cli.cli.commands import VERBS
from obk_cli.process.identity import this_process
from obk_cli.record.mcap_writer import BagWriter

from ..ros.stack import EXAMPLE, OBK, calm  # noqa: TID252 - shared by folders of tests
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
"""Run each command in a fork of one process, which imports modules only once."""
SEEING = """
import os, psutil
from obk_cli.runs import orphans
seen = map(int, os.environ["SEEN"].split())
seen = [psutil.Process(pid) for pid in seen if psutil.pid_exists(pid)]
orphans._own_processes = lambda: seen
"""
"""Neither show nor kill orphans of other stacks on this machine."""
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
    "bag": ("bag info speed.mcap", "bag info none.mcap"),
    "plot": (
        "plot speed.mcap speed.data --output speed.svg",
        "plot speed.mcap speed",
        "plot speed.mcap sped.data",
        "plot dummy speed.data",
        "plot speed.mcap speed.data --xlim 2 1",
        "plot speed.mcap speed.data --xlim 100 200",
        "plot speed.mcap speed.data --output speed.gif",
    ),
    "diff": ("diff before.mcap after.mcap", "diff before.mcap none"),
    "export": (
        "export after.mcap --to csv --output tables",
        "export before.mcap --to xlsx",
        "export before.mcap --to csv --topic ets",
    ),
    "play": (
        "play before.mcap --topic ctrl",
        "play before.mcap --nodes control",
        f"play before.mcap --into {DUMMY} --nodes estimtion",
        f"play before.mcap --into {DUMMY} --nodes planner",
        f"play before.mcap --into {DUMMY} --nodes estimation",
    ),
    "schema": ("schema --install-vscode", "schema nowhere"),
    "sweep": (
        "sweep missing.yaml",
        f"sweep {DUMMY} --vary onboard.robt[0].is_simulated=true,false",
        f"sweep {DUMMY} --vary onboard.control[0].timers[0].timer_period_sec=0.001",
        f"sweep {DUMMY} --vary onboard.control[0].timers[0].timer_period_sec=0..1",
        f"sweep {DUMMY} --engine ray",
    ),
    "logs": ("logs", "logs dummy"),
    # Not all checks, because their findings depend on the machine.
    "doctor": ("doctor --list", "doctor workspce", "doctor folders workspace"),
}
OF_RUNS = {"ps": ("ps",), "reap": ("reap --dry-run", "reap", "reap")}
OF_ROS = {
    "lifecycle": ("lifecycle get", "lifecycle activate"),
    "topic": ("topic list", "topic info /ctrl", "topic echo /ctrl", "topic hz /ctrl"),
    "node": ("node list", "node info control"),
    "param": ("param list control", "param get control amplitude"),
    "service": ("service list", "service call /reset"),
    "record": ("record", "record /a --duration 0.1 --output a.mcap", "record /a --run none"),
    "build": (
        "build",
        "new msgs my_msgs",
        "build",
        "build",
        "build other_msgs",
        "build --workspace apart/wrong",
    ),
    "launch": (
        "launch missing.yaml",
        "launch broken.yaml",
        f"launch {DUMMY} --device nothing",
        f"launch {DUMMY} --duration 0.5 --timeout 60 --hang-after 20",
    ),
    "rehearse": (
        "rehearse missing.yaml",
        f"rehearse {DUMMY} --node controll",
        f"rehearse {DUMMY} --fault burn",
        f"rehearse {DUMMY} --node control --fault kill",
    ),
}
LIVE = ("monitor --once --period 0.2", "monitor --once --run arm", "monitor")
VARYING = {
    "build": ((r" in [\d.]+ s$", " in <time> s"), (r"compiled   \d+", "compiled   <count>")),
    "launch": (
        (r"dummy_\d{8}_\d{6}\b", "dummy_<date>"),
        (r"^\[ *[\d.]+ s\]", "[<time> s]"),
        (r"\(\d+ ms\)", "(<time> ms)"),
        (r"process \d+", "process <pid>"),
    ),
    "rehearse": (
        (r"dummy_\d{8}_\d{6}\b", "dummy_<date>"),
        (r" +[\d.]+ +[\d.]+  ok$", "  <time>  <time>  ok"),
    ),
    "record": ((r" in [\d.]+ s,", " in <time> s,"),),
    "monitor": ((r"monitor [\d.]+ %", "monitor <load> %"), (r"  1234 .*", "  1234  ...")),
}
"""Text in a transcript that differs between runs -> its replacement."""


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


def nothing(_: Path) -> None:
    """No preparation."""


def recording(folder: Path) -> None:
    """A recording of four seconds with one topic and two lost messages."""
    second = 1_000_000_000
    with BagWriter(folder / "speed.mcap") as writer:
        writer.describe({"obelisk": {"run": "arm_1"}}, {"plan.json": "{}"}, second)
        channel = writer.add_topic("/speed", "std_msgs/msg/Bool", "bool data\n", {})
        for number in range(1, 6):
            received_ns = number * second
            writer.add_message(channel, b"\0\1\0\0\1", received_ns, received_ns - 1, number)
        writer.describe({DROPS: {"/speed": "2"}}, {}, second)


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


def two_runs(folder: Path) -> None:
    """Recordings of two runs with different gains."""
    write_run(folder / "before.mcap", 20.0)
    write_run(folder / "after.mcap", 25.0)


def wrong_messages(folder: Path) -> None:
    """A workspace with a message package that has an invalid definition."""
    package = folder / "apart/wrong/src/wrong_msgs"
    (package / "msg").mkdir(parents=True)
    (folder / "apart/COLCON_IGNORE").touch()
    (package / "msg/Wrong.msg").write_text("float46 speed\n")
    (package / "CMakeLists.txt").write_text(
        'project(wrong_msgs)\nrosidl_generate_interfaces(wrong_msgs "msg/Wrong.msg")\n'
    )
    (package / "package.xml").write_text(
        "<package format='3'><name>wrong_msgs</name><version>0.0.0</version>"
        "<member_of_group>rosidl_interface_packages</member_of_group></package>"
    )
    (folder / "src").mkdir()


def calm_dummy(folder: Path) -> None:
    """The example at rates that a busy machine can keep."""
    dummy = folder / "examples" / "dummy"
    shutil.copytree(EXAMPLE.parent, dummy)
    calm(dummy)


PREPARED: Mapping[str, Callable[[Path], None]] = {
    "bag": recording,
    "plot": recording,
    **dict.fromkeys(("diff", "export", "play"), two_runs),
    "build": wrong_messages,
    "launch": calm_dummy,
    "rehearse": calm_dummy,
}


def transcript(
    commands: tuple[str, ...],
    folder: Path,
    repository: Path,
    *,
    seen: Mapping[int, str] | None = None,
) -> str:
    """Run the commands in a folder; return them with their outputs and exit codes.

    `seen`: the processes to find, and the replacements of their IDs; None: all.
    """
    (folder / "broken.yaml").write_text(BROKEN)
    (folder / "warning.yaml").write_text(WARNING)
    dummy = folder / "examples" / "dummy"
    if not dummy.exists():
        shutil.copytree(repository / "examples" / "dummy", dummy)
    environment = {
        **{key: value for key, value in os.environ.items() if not key.startswith("COV")},
        "HOME": str(folder),
        "OBK_HOME": str(folder / ".obk_home"),
        "XDG_CONFIG_HOME": str(folder / ".config"),
        "XDG_CACHE_HOME": str(folder / ".cache"),
        "TMPDIR": str(folder),
        "COLUMNS": "100",
        "TZ": "UTC",
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
    PREPARED.get(name, nothing)(tmp_path)
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
    # The launcher's uptime is fixed; without its reply, the age of the process is shown.
    silent = re.sub(r"up [\d:]+", "up <time>", silent)
    text = "\n".join((nothing, running, silent))
    compare("ps", text, request.config.getoption("--update-golden"))


def test_reap_prints_its_transcript(
    tmp_path: Path, repository: Path, request: pytest.FixtureRequest
) -> None:
    with orphan() as seen:
        text = transcript(OF_RUNS["reap"], tmp_path, repository, seen=seen)
    compare("reap", text, request.config.getoption("--update-golden"))


@pytest.mark.ros
@pytest.mark.mujoco
def test_test_prints_its_transcript(
    tmp_path: Path, repository: Path, request: pytest.FixtureRequest
) -> None:
    (tmp_path / "test_rod.py").write_text(CLOSED_LOOP)
    text = transcript(OF_TESTS["test"], tmp_path, repository)
    text = re.sub(r"\b\d+\.\d+ ?(s\b|x\b)(?! simulated)", r"<number> \1", text)
    compare("test", text, request.config.getoption("--update-golden"))


@pytest.mark.ros
def test_monitor_prints_its_transcript(
    tmp_path: Path, repository: Path, request: pytest.FixtureRequest, ros_domain: int
) -> None:
    states = {ROBOT: "active", CONTROL: "inactive", JOY: ""}
    nothing = transcript(LIVE[:1], tmp_path, repository)
    runs = tmp_path / ".obk_home" / "runs"
    with fake_stack(runs, states, devices=("onboard",), domain=ros_domain):
        running = transcript(LIVE, tmp_path, repository)
    text = "\n".join((nothing, running)).replace(f"domain {ros_domain}", "domain <domain>")
    compare("monitor", text, request.config.getoption("--update-golden"))


@pytest.mark.ros
def test_web_prints_its_transcript(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    monkeypatch.setenv("OBK_HOME", str(tmp_path))
    parts = []
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        for command in ("web --port 0", f"web --port {port}"):
            parts.append(f"$ obk {command}\n{until_interrupted(command)}")
    text = "\n".join(parts).replace(str(port), "<taken>")
    text = re.sub(r":\d+/\?token=\S+", ":<port>/?token=<token>", text)
    compare("web", text, request.config.getoption("--update-golden"))


def until_interrupted(command: str) -> str:
    """The output of a command that ends, or that is interrupted as soon as it waits."""
    with subprocess.Popen(
        [OBK, *command.split()], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        assert process.stdout is not None
        lines = []
        for line in process.stdout:
            lines.append(line)
            if line == "Ctrl-C stops the server\n":
                process.send_signal(signal.SIGINT)
    return f"{''.join(lines)}[exit code {process.returncode}]\n"


@contextmanager
def orphan() -> Iterator[Mapping[int, str]]:
    """A process whose launcher has ended."""
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
    for varying, name_of_it in VARYING.get(name, ()):
        text = re.sub(varying, name_of_it, text, flags=re.MULTILINE)
    text = re.sub(r"(?:^  \w+: process <pid>\n)+", in_order_of_names, text, flags=re.MULTILINE)
    expected = TRANSCRIPTS / f"{name}.txt"
    if is_update:
        expected.parent.mkdir(exist_ok=True)
        expected.write_text(text, encoding="utf-8")
    assert text == expected.read_text(encoding="utf-8")


def in_order_of_names(lines: re.Match[str]) -> str:
    """Sort the lines of processes that start at once, which report in any order."""
    return "".join(sorted(lines[0].splitlines(keepends=True)))


def test_every_transcript_is_of_a_command() -> None:
    names = {path.stem for path in TRANSCRIPTS.glob("*.txt")}
    assert names == VERBS.keys()
