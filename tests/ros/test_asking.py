"""A running stack inspected, controlled and stopped from another terminal, and its leftovers."""

import hashlib
import json
import signal
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import pytest

from obk_cli.process.identity import start_s

from ..turns import turn_of_leftovers  # noqa: TID252 - shared by folders of tests
from .stack import DEADLINE_S, DUMMY, Launched, eventually, launched, obk

pytestmark = pytest.mark.ros

NODES = ("/obelisk_robot_0", "/obelisk_estimation_0", "/obelisk_control_0")
ROUND = (
    ("deactivate", "inactive"),
    ("cleanup", "unconfigured"),
    ("configure", "inactive"),
    ("activate", "active"),
)


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("OBK_HOME", str(tmp_path / "home"))
    return tmp_path / "home"


def reported(*arguments: object) -> dict[str, Any]:
    result = obk(*arguments, "--format", "json")
    assert result.returncode == 0, result.stdout + result.stderr
    return dict(json.loads(result.stdout))


def states() -> dict[str, str]:
    """The names of the nodes found so far."""
    return dict(json.loads(obk("lifecycle", "get", "--format", "json").stdout or "{}"))


def node_pids(run: Launched) -> dict[str, int]:
    return {name: run.node(name.strip("/")).pid for name in NODES}


def test_the_launcher_reports_and_moves_its_stack_again_and_again() -> None:
    with launched(DUMMY, "--quiet") as run:
        (stack,) = json.loads(obk("ps", "--format", "json").stdout)["stacks"]
        assert (stack["launcher"], stack["state"]) == (run.process.pid, "active")
        assert {node["node"]: node["pid"] for node in stack["nodes"]} == node_pids(run)
        for _ in range(2):
            for verb, goal in ROUND:
                assert reported("lifecycle", verb)["success"] is True
                assert reported("lifecycle", "get") == dict.fromkeys(NODES, goal)
        assert reported("lifecycle", "list", "robot") == {
            NODES[0]: {"state": "active", "transitions": ["deactivate", "shutdown"]}
        }
    assert run.process.returncode == 0, run.text


@pytest.mark.slow
def test_without_the_run_registry_the_graph_alone_is_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with launched(DUMMY, "--quiet") as run:
        monkeypatch.setenv("OBK_HOME", str(tmp_path / "another host"))
        eventually(lambda: states() == dict.fromkeys(NODES, "active"), "all three")
        # By their full names, so that the command waits for all, however slow the graph is.
        patient = (*NODES, "--timeout", DEADLINE_S)
        for verb, goal in ROUND:
            answer = reported("lifecycle", verb, *patient)
            assert answer["success"] is True
            reached = {member["node"]: member["state"] for member in answer["members"]}
            assert reached == dict.fromkeys(NODES, goal)
        assert reported("lifecycle", "get", *patient) == dict.fromkeys(NODES, "active")
        refused = obk("lifecycle", "configure", NODES[0], "--timeout", DEADLINE_S)
        assert refused.returncode == 1
        assert "`configure` " in refused.stderr
    assert run.process.returncode == 0, run.text


def test_stop_ends_the_stack_cleanly_and_waits_for_it() -> None:
    with launched(DUMMY, "--quiet") as run:
        result = obk("stop")
        assert (result.returncode, result.stdout) == (0, "dummy: ended\n")
        assert not run.left_over()
        assert obk("ps").stdout.startswith("no stack is running on this host\n")
        assert run.process.wait(DEADLINE_S) == 0
    assert "`obk stop`" in run.text


def test_a_launcher_that_takes_too_long_is_killed_on_demand_with_all_of_its_nodes() -> None:
    with launched(DUMMY, "--quiet") as run:
        result = obk("stop", "dummy", "--timeout", "0.001", "--kill")
        assert (result.returncode, result.stdout) == (0, "dummy: killed\n")
        eventually(lambda: not run.left_over(), f"the end of {run.descendants}")


def test_orphans_of_a_launcher_are_found_and_ended() -> None:
    with turn_of_leftovers(), launched(DUMMY, "--quiet") as run:
        nodes = node_pids(run)
        (warden,) = psutil.Process(run.process.pid).children()
        warden.suspend()
        run.process.send_signal(signal.SIGKILL)
        run.process.wait(DEADLINE_S)
        left = json.loads(obk("ps", "--format", "json").stdout)["orphans"]
        assert {process["pid"] for process in left} >= set(nodes.values())
        assert "obk reap" in obk("ps").stdout
        assert obk("reap", "--dry-run").returncode == 0
        assert all(start_s(pid) is not None for pid in nodes.values())
        assert obk("reap").returncode == 0
        assert all(start_s(pid) is None for pid in nodes.values())
        with suppress(psutil.NoSuchProcess):  # killed if it was too slow to end
            warden.resume()
        eventually(lambda: not run.left_over(), f"the end of {run.descendants}")


def test_a_finished_run_reports_its_config_and_its_outcome(home: Path) -> None:
    begin = time.time()
    assert obk("launch", DUMMY, "--duration", "0", "--quiet").returncode == 0
    (folder,) = (home / "runs").glob("dummy_*")
    run = json.loads((folder / "run.json").read_text())
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    assert events[0]["event"] == "Phase"
    assert events[-1] == {**events[-1], "event": "Ended", "exit_code": 0, "cause": ""}
    assert run["nodes"] == list(NODES)
    assert (folder / "params" / "obelisk_robot_0.yaml").is_file()
    plan = obk("compile", DUMMY).stdout
    assert run["plan_sha256"] == hashlib.sha256(plan.encode()).hexdigest()
    assert run["plan"] == json.loads(plan)
    assert {"obk", "python", "rclpy", "ros", "mujoco"} <= set(run["versions"])
    assert (run["exit_code"], run["cause"]) == (0, "")
    assert run["ended"] >= begin
    assert not (folder / "control.sock").exists()
    assert obk("logs").stdout.splitlines()[-1] == "stopped cleanly"
