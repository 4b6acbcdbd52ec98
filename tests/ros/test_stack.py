"""The dummy stack, launched for real: up in order, driven, ended, killed; nothing stays behind."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from .stack import DUMMY, eventually, launched, obk

pytestmark = pytest.mark.ros

NODES = ("/obelisk_robot_0", "/obelisk_estimation_0", "/obelisk_control_0")


@pytest.fixture(autouse=True)
def _own_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OBK_HOME", str(tmp_path / "home"))


def states(*arguments: str) -> dict[str, str]:
    result = obk("lifecycle", *arguments, "--format", "json")
    return dict(json.loads(result.stdout))


@pytest.mark.parametrize("config", ["dummy.yaml", "dummy_new.yaml"])
def test_both_spellings_come_up_and_end_in_order(config: str) -> None:
    result = obk("launch", DUMMY.with_name(config), "--duration", "1", "--color", "never")
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
    assert lines[-1] == "ended in order"


def test_a_run_leaves_its_logs_and_events(tmp_path: Path) -> None:
    assert obk("launch", DUMMY, "--duration", "0.5").returncode == 0
    (run,) = (tmp_path / "home" / "runs").iterdir()
    events = [json.loads(line) for line in (run / "events.jsonl").read_text().splitlines()]
    assert events[0]["event"] == "Phase"
    assert events[-1] == {**events[-1], "event": "Ended", "exit_code": 0, "cause": ""}
    assert json.loads((run / "run.json").read_text())["nodes"] == list(NODES)
    assert (run / "params" / "obelisk_robot_0.yaml").is_file()


def test_all_nodes_go_round_the_life_cycle_from_another_terminal() -> None:
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
        assert "'configure' starts from unconfigured, and the node is active" in refused.stderr
        unknown = obk("lifecycle", "get", "contrl_0")
        assert unknown.returncode == 1
        assert "help: did you mean `/obelisk_control_0`?" in unknown.stderr
        assert states("shutdown") == dict.fromkeys(NODES, "finalized")
    assert run.process.returncode == 0, run.text
    assert not run.left_over()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_the_launcher_ends_the_stack_in_order(number: int) -> None:
    with launched(DUMMY, "--quiet") as run:
        run.process.send_signal(number)
        run.process.wait(20)
    assert run.process.returncode == 0, run.text
    assert run.lines[-1] == "ended in order"
    assert not run.left_over()


def test_a_killed_launcher_leaves_no_process() -> None:
    with launched(DUMMY, "--quiet") as run:
        assert len(run.left_over()) == 4  # the nodes, and their warden
        run.process.kill()
        eventually(lambda: not run.left_over(), f"the end of {run.descendants}")


def test_a_launcher_killed_during_the_bring_up_leaves_no_process() -> None:
    for delay_s in (0.2, 0.5, 0.8, 1.1):
        environment = {**os.environ, "OBK_TEST_MARK": f"mark-{os.getpid()}-{delay_s}"}
        obk_program = Path(sys.executable).with_name("obk")
        process = subprocess.Popen(
            [obk_program, "launch", DUMMY], stdout=subprocess.DEVNULL, env=environment
        )
        time.sleep(delay_s)
        process.kill()
        process.wait()
        eventually(lambda e=environment: not _marked(e["OBK_TEST_MARK"]), f"after {delay_s} s")


def _marked(mark: str) -> list[str]:
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if mark.encode() in (folder / "environ").read_bytes():
                found.append(folder.name)
        except OSError:
            continue
    return found


def test_a_killed_warden_takes_the_nodes_along_and_the_launcher_says_so() -> None:
    with launched(DUMMY, "--quiet") as run:
        warden = next(p for p in run.descendants if any(a.endswith("warden.py") for a in p.cmdline()))
        warden.kill()
        run.process.wait(20)
    assert run.process.returncode == 1
    assert "the process that watched over the nodes is gone" in run.lines[-1]
    assert not run.left_over()


def test_a_node_that_is_killed_takes_the_stack_down_and_is_named() -> None:
    with launched(DUMMY, "--quiet") as run:
        run.node("obelisk_estimation_0").kill()
        run.process.wait(20)
    assert run.process.returncode == 1
    cause = "failed: /obelisk_estimation_0: the process was ended by SIGKILL"
    assert run.lines[-1].startswith(cause)
    assert not run.left_over()


def test_a_node_that_fails_to_configure_is_shown_with_its_own_words(tmp_path: Path) -> None:
    config = tmp_path / "broken.yaml"
    text = DUMMY.read_text().replace("dummy.xml", str(DUMMY.with_name("dummy.xml")))
    config.write_text(text.replace("msg_type: EstimatedState", "msg_type: VelocityCommand", 1))
    result = obk("launch", config, "--ignore", "OBK2", "--set", _wrong_type())
    assert result.returncode == 1, result.stdout
    assert "estimation_0: configure FAILED" in result.stdout
    assert "in the code and a ObkImu in the config" in result.stdout
    assert "ended in order" not in result.stdout


def _wrong_type() -> str:
    return "onboard.estimation[0].subscribers[0].msg_type=ObkImu"


def test_a_config_with_errors_starts_nothing(tmp_path: Path) -> None:
    config = tmp_path / "bad.yaml"
    config.write_text(DUMMY.read_text().replace("publishers:", "publishrs:", 1))
    result = obk("launch", config)
    assert result.returncode == 1
    assert "publishrs" in result.stderr
    assert not (tmp_path / "home").exists()


def test_a_scaffolded_controller_runs_in_place_of_the_example(tmp_path: Path) -> None:
    (tmp_path / "ws" / "src").mkdir(parents=True)
    made = obk("new", "controller", "foo", "--dest", tmp_path / "ws" / "src")
    assert made.returncode == 0, made.stderr
    config = tmp_path / "ws" / "foo.yaml"
    text = DUMMY.read_text().replace("dummy.xml", str(DUMMY.with_name("dummy.xml")))
    text = text.replace("params_path: dummy_params.txt", "")
    text = text.replace("pkg: obelisk_control_py", "pkg: foo")
    text = text.replace("executable: example_position_setpoint_controller", "executable: foo")
    config.write_text(text)
    with launched(config, "--quiet") as run:
        assert states("get", "control") == {NODES[2]: "active"}
        assert any("foo" in argument for argument in run.node("obelisk_control_0").cmdline())
    assert run.process.returncode == 0, run.text


def test_an_rmw_that_is_not_installed_is_told_and_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")
    result = obk("launch", DUMMY, "--duration", "0", "--quiet")
    assert result.returncode == 0, result.stdout
    assert "RMW_IMPLEMENTATION=rmw_cyclonedds_cpp is not installed here" in result.stderr
