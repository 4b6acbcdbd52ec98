"""The dummy stack, launched for real: start order, control, stop, kill, no leftovers."""

import json
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import psutil
import pytest

from obelisk_spec.runtime_protocol import REJECTION
from obk_cli.launch.ros_nodes import RosNodes, open_ros_nodes
from obk_cli.ros.environment import ros_environment

from .stack import (
    DEADLINE_S,
    DUMMY,
    EXAMPLE,
    OBK,
    Launched,
    arguments_of,
    eventually,
    launched,
    marked,
    obk,
    patient,
    started,
)

pytestmark = pytest.mark.ros

NOBODYS_DOMAIN = "101"
"""A domain that no test uses, see `conftest`, and no other user of ROS on this machine."""
NODES = ("/obelisk_robot_0", "/obelisk_estimation_0", "/obelisk_control_0")


@pytest.fixture(autouse=True)
def _own_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OBK_HOME", str(tmp_path / "home"))


def states(*arguments: str) -> dict[str, str]:
    reported = json.loads(obk("lifecycle", *arguments, "--format", "json").stdout)
    members = reported.get("members")
    return {m["node"]: m["state"] for m in members} if members else dict(reported)


@pytest.mark.parametrize(
    "config", [pytest.param("dummy.yaml", marks=pytest.mark.slow), "dummy_new.yaml"]
)
def test_both_formats_start_and_end_cleanly(config: str) -> None:
    result = obk("launch", EXAMPLE.with_name(config), "--duration", "1", "--color", "never")
    assert result.returncode == 0, result.stdout + result.stderr
    lines = [line.strip() for line in result.stdout.splitlines()]
    steps = [line.partition(" ok")[0] for line in lines if " ok (" in line]
    assert steps[:6] == [
        "robot_0: configure",
        "estimation_0: configure",
        "control_0: configure",
        "robot_0: activate",
        "estimation_0: activate",
        "control_0: activate",
    ]
    assert lines[-1] == "stopped cleanly"


def test_all_nodes_run_through_the_lifecycle_from_another_terminal() -> None:
    with launched(DUMMY, "--quiet") as run:
        assert states("get") == dict.fromkeys(NODES, "active")
        for verb, goal in (
            ("deactivate", "inactive"),
            ("cleanup", "unconfigured"),
            ("configure", "inactive"),
            ("activate", "active"),
        ):
            assert states(verb) == dict.fromkeys(NODES, goal)
        assert states("deactivate", "control_0") == {NODES[2]: "inactive"}
        assert states("get", "control", "robot") == {NODES[0]: "active", NODES[2]: "inactive"}
        refused = obk("lifecycle", "configure", "robot")
        assert refused.returncode == 1
        assert NODES[0] in refused.stderr
        unknown = obk("lifecycle", "get", "contrl_0")
        assert unknown.returncode == 1
        assert "did you mean" in unknown.stderr
        assert "`/obelisk_control_0`" in unknown.stderr
        assert states("shutdown") == dict.fromkeys(NODES, "finalized")
        run.process.wait(DEADLINE_S)  # A SIGINT during shutdown would speed it up.
    assert run.process.returncode == 0, run.text
    assert not run.left_over()


@pytest.fixture
def _not_under_nohup() -> Iterator[None]:
    """Child processes react to SIGHUP, even if the parent of the tests ignores it."""
    before = signal.signal(signal.SIGHUP, lambda *_: None)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.usefixtures("_not_under_nohup")
@pytest.mark.parametrize(
    "number", [signal.SIGTERM, pytest.param(signal.SIGHUP, marks=pytest.mark.slow)]
)  # SIGINT stops the others
def test_a_signal_to_the_launcher_ends_the_stack_cleanly(number: int) -> None:
    with launched(DUMMY, "--quiet") as run:
        run.process.send_signal(number)
        run.process.wait(DEADLINE_S)
    assert run.process.returncode == 0, run.text
    assert "stopped cleanly" in run.lines
    assert not run.left_over()


@pytest.fixture(params=["on", "off"])
def preload(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Whether nodes are forked from the preload server."""
    monkeypatch.setenv("OBK_PRELOAD", request.param)
    return str(request.param)


@pytest.mark.usefixtures("unmeasured")
def test_a_killed_launcher_leaves_no_process(preload: str) -> None:
    with launched(DUMMY, "--quiet") as run:
        # The nodes, their warden, and the preload server.
        assert len(run.left_over()) == {"on": 5, "off": 4}[preload]
        run.process.kill()
        eventually(lambda: not run.left_over(), f"the end of {run.descendants}")


@pytest.mark.parametrize(
    "moment",
    [
        "logs in",
        pytest.param(": process ", marks=pytest.mark.slow),
        pytest.param("s] ready", marks=pytest.mark.slow),
        ": configure ok",
    ],
)
def test_a_launcher_killed_during_the_bring_up_leaves_no_process(moment: str) -> None:
    with started(DUMMY, "--quiet") as run:
        run.wait_for_line(moment)
        run.process.kill()
        run.process.wait(DEADLINE_S)
        eventually(lambda: not marked(), f"the end of all processes after '{moment}'")


def warden_of(run: Launched) -> psutil.Process:
    return next(p for p in run.descendants if any(a.endswith("warden.py") for a in arguments_of(p)))


@pytest.mark.usefixtures("preload")
def test_a_killed_warden_ends_the_nodes_and_the_launcher_reports_it() -> None:
    with launched(DUMMY, "--quiet") as run:
        warden = warden_of(run)
        warden.kill()
        run.process.wait(DEADLINE_S)
    assert run.process.returncode == 1
    assert "process" in run.cause
    assert not run.left_over()


@pytest.mark.usefixtures("preload")
def test_a_launcher_killed_together_with_its_warden_leaves_no_node() -> None:
    with launched(DUMMY, "--quiet") as run:
        warden = warden_of(run)
        # So that neither detects the other one's exit.
        for process in (psutil.Process(run.process.pid), warden):
            process.suspend()
        warden.kill()
        run.process.kill()
        eventually(lambda: not run.left_over(), f"the end of {run.descendants}")


def test_a_node_that_fails_to_configure_is_shown_with_its_own_message(tmp_path: Path) -> None:
    result = obk("launch", broken(tmp_path), "--ignore", "OBK2,OBK407", "--set", _wrong_type())
    assert result.returncode == 1, result.stdout
    assert "estimation_0: configure FAILED" in result.stdout
    assert "`ObkImu`" in result.stdout
    assert "stopped cleanly" not in result.stdout


def broken(folder: Path) -> Path:
    """A config with a message type that contradicts the estimator's code, to be overridden."""
    config = folder / "broken.yaml"
    text = DUMMY.read_text().replace("dummy.xml", str(DUMMY.with_name("dummy.xml")))
    config.write_text(text.replace("msg_type: EstimatedState", "msg_type: VelocityCommand", 1))
    return config


def _wrong_type() -> str:
    return "onboard.estimation[0].subscribers[0].msg_type=ObkImu"


def test_a_config_with_errors_starts_nothing(tmp_path: Path) -> None:
    config = tmp_path / "bad.yaml"
    config.write_text(DUMMY.read_text().replace("publishers:", "publishrs:", 1))
    result = obk("launch", config)
    assert result.returncode == 1
    assert "publishrs" in result.stderr
    assert not (tmp_path / "home").exists()


def test_a_scaffolded_controller_replaces_the_one_of_the_example(tmp_path: Path) -> None:
    (tmp_path / "ws" / "src").mkdir(parents=True)
    made = obk("new", "controller", "foo", "--dest", tmp_path / "ws" / "src")
    assert made.returncode == 0, made.stderr
    config = with_controller(tmp_path / "ws" / "foo.yaml", "foo")
    with launched(config, "--quiet") as run:
        assert states("get", "control") == {NODES[2]: "active"}
        assert any("foo" in argument for argument in run.node("obelisk_control_0").cmdline())
    assert run.process.returncode == 0, run.text


def with_controller(config: Path, package: str) -> Path:
    """The dummy's config with another controller."""
    text = DUMMY.read_text().replace("dummy.xml", str(DUMMY.with_name("dummy.xml")))
    text = text.replace("params_path: dummy_params.txt", "")
    text = text.replace("pkg: obelisk_control_py", f"pkg: {package}")
    name = "executable: example_position_setpoint_controller"
    config.write_text(text.replace(name, f"executable: {package}"))
    return config


def test_a_second_launch_in_the_domain_is_rejected_and_the_first_continues() -> None:
    with launched(DUMMY, "--quiet") as run:
        second = obk("launch", DUMMY, "--quiet")
        assert second.returncode == 1
        domain = os.environ["ROS_DOMAIN_ID"]
        assert second.stderr.startswith(
            f"error: the stack `dummy` is already running in ROS domain {domain} "
            f"(process {run.process.pid}, /obelisk_control_0, "
        )
        assert "ROS_DOMAIN_ID" in second.stderr
        assert states("get") == dict.fromkeys(NODES, "active")
        elsewhere = obk("lifecycle", "get", env={"ROS_DOMAIN_ID": NOBODYS_DOMAIN})
        assert f"domain {domain}" in elsewhere.stderr
    assert run.process.returncode == 0, run.text
    assert obk("launch", DUMMY, "--duration", "0", "--quiet").returncode == 0


def test_a_run_whose_robot_rejects_commands_to_the_end_fails(tmp_path: Path) -> None:
    """With a second actuator, the controller's commands are too short."""
    shutil.copytree(DUMMY.parent, tmp_path, dirs_exist_ok=True)
    model = ElementTree.parse(tmp_path / "dummy.xml")
    actuators = model.getroot().find("actuator")
    assert actuators is not None
    ElementTree.SubElement(actuators, "motor", name="second", joint="joint1")
    for key in model.getroot().iter("key"):
        key.attrib.pop("ctrl")
    model.write(tmp_path / "dummy.xml")
    with launched(tmp_path / DUMMY.name) as run:
        reports = ("topic", "echo", "/diagnostics", "--count", "3")
        eventually(lambda: REJECTION in obk(*reports).stdout, "the robot's report")
    assert run.process.returncode == 1
    assert "/obelisk_robot_0" in run.cause


def test_a_duration_in_simulated_time_ends_a_run_at_any_speed() -> None:
    fast = "onboard.robot[0].params.realtime_factor=0"
    run = obk("launch", DUMMY, "--sim-duration", "100", "--set", fast, "--format", "json")
    assert run.returncode == 0, run.stdout + run.stderr
    events = list(map(json.loads, run.stdout.splitlines()))
    phases = [event["name"] for event in events if event["event"] == "Phase"]
    assert phases[-3:] == ["active", "stopping", "stopped"]


@pytest.mark.slow
def test_unread_output_blocks_neither_the_stack_nor_its_end(tmp_path: Path) -> None:
    read_fd, write_fd = os.pipe()
    events = tmp_path / "home" / "runs"
    command = [OBK, *patient("launch", chatty(tmp_path))]
    with subprocess.Popen(command, stdout=write_fd) as process:
        os.close(write_fd)
        # More than a pipe and the queue hold, so the screen has stalled by then.
        eventually(
            lambda: any(log.stat().st_size > 3 << 20 for log in events.glob("*/obelisk_con*.log")),
            "much output",
        )
        eventually(lambda: states("get") == dict.fromkeys(NODES, "active"), "the stack")
        process.send_signal(signal.SIGINT)
        assert process.wait(DEADLINE_S) == 0
    os.close(read_fd)
    (log,) = events.glob("*/launch.log")
    assert log.read_text().splitlines()[-1] == "stopped cleanly"


@pytest.mark.slow
def test_a_reader_that_leaves_ends_the_stack_cleanly(tmp_path: Path) -> None:
    with subprocess.Popen(
        [OBK, *patient("launch", chatty(tmp_path))],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == ""
        assert process.wait(DEADLINE_S) == 0
    (log,) = (tmp_path / "home" / "runs").glob("*/launch.log")
    assert "stopping" in log.read_text()


def chatty(folder: Path) -> Path:
    """A config whose controller prints endlessly."""
    package = folder / "ws" / "src" / "chatty"
    made = obk("new", "controller", "chatty", "--dest", package.parent)
    assert made.returncode == 0, made.stderr
    (node,) = package.glob("chatty/chatty.py")
    text = node.read_text()
    talk = (
        "import threading\n\n\ndef talk() -> None:\n    while True:\n        print('x' * 200)\n\n\n"
    )
    start = "def main("
    begin = "    threading.Thread(target=talk, daemon=True).start()\n"
    head, _, tail = text.partition(start)
    signature, _, body = tail.partition(":\n")
    doc, _, rest = body.partition('"""\n')
    node.write_text(f'{head}{talk}{start}{signature}:\n{doc}"""\n{begin}{rest}')
    return with_controller(folder / "ws" / "chatty.yaml", "chatty")


@pytest.mark.slow
def test_without_a_log_folder_and_the_requested_rmw_the_stack_runs_and_reports_it(
    tmp_path: Path,
) -> None:
    (tmp_path / "file").write_text("")
    asked = {"OBK_HOME": str(tmp_path / "file"), "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}
    result = obk("launch", DUMMY, "--duration", "0", env=asked)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "RMW_IMPLEMENTATION=rmw_cyclonedds_cpp" in result.stderr
    warnings = [line for line in result.stdout.splitlines() if line.startswith("warning: no log")]
    assert len(warnings) == 1
    assert "stopped cleanly" in result.stdout


def test_a_fault_in_a_transition_requested_elsewhere_keeps_the_stack_running(
    tmp_path: Path,
) -> None:
    config = broken(tmp_path)
    override = ("--ignore", "OBK2,OBK407", "--set", _wrong_type())
    with launched(config, "--quiet", "--until", "none", *override, phase="started") as run:
        refused = obk("lifecycle", "configure", "estimation_0")
        assert refused.returncode == 1
        run.wait_for_line("estimation_0: configure FAILED")
        assert set(states("get")) == set(NODES)
    assert run.process.returncode == 0, run.text


def test_a_node_that_is_stopped_is_listed_without_an_answer() -> None:
    with launched(DUMMY, "--quiet", "--on-crash", "ignore", "--hang-after", "3") as run:
        run.node("obelisk_estimation_0").suspend()
        wanted = {NODES[0]: "active", NODES[1]: "no answer", NODES[2]: "active"}
        eventually(lambda: states("get") == wanted, "that it does not answer")
        assert obk("lifecycle", "get").returncode == 1
        run.node("obelisk_estimation_0").resume()


def test_a_second_sigint_ends_a_stack_that_hangs_during_shutdown() -> None:
    with launched(DUMMY, "--quiet") as run:
        for name in NODES:
            run.node(name.strip("/")).suspend()
        run.process.send_signal(signal.SIGINT)
        run.wait_for_line("stopping")
        # Simultaneous signals are one request; these are sent until it is no longer one.
        eventually(lambda: is_killing(run) or run.process.send_signal(signal.SIGINT), "the end")
        run.process.wait(DEADLINE_S)
    assert run.process.returncode == 1
    assert not run.left_over()


def is_killing(run: Launched) -> bool:
    return any("was terminated by SIGKILL" in line for line in run.lines)


def test_an_exception_next_to_our_ros_node_leaves_none_behind(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    environment = ros_environment()
    for name, value in environment.variables.items():
        monkeypatch.setenv(name, value)  # removed at the end
    opened: list[RosNodes] = []

    def fail() -> None:
        with open_ros_nodes("probe", environment) as ros:
            opened.append(ros)
            raise RuntimeError("boom")

    with pytest.raises(RuntimeError, match="boom"):
        fail()
    (ros,) = opened
    assert not ros._thread.is_alive()
    assert not ros._node.context.ok()


def test_a_node_that_fails_by_itself_while_active_takes_the_stack_down(tmp_path: Path) -> None:
    package = tmp_path / "ws" / "src" / "faulty"
    assert obk("new", "controller", "faulty", "--dest", package.parent).returncode == 0
    node = package / "faulty" / "faulty.py"
    text = node.read_text()
    assert "        return msg" in text
    node.write_text(text.replace("        return msg", "        raise ValueError('no gain')"))
    config = with_controller(tmp_path / "ws" / "faulty.yaml", "faulty")
    result = obk("launch", config, "--quiet", "--ignore", "OBK")
    assert result.returncode == 1, result.stdout
    cause = "failed: /obelisk_control_0 failed: "
    reported = next(line for line in result.stdout.splitlines() if line.startswith("failed: "))
    assert reported.startswith(cause), result.stdout
    assert reported.endswith("ValueError: no gain"), result.stdout
    assert f" {config}:" in result.stdout
