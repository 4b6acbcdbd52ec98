"""The failure table, tested on the dummy stack by `obk rehearse`: every rule and every fault."""

import json
import os
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path

import psutil
import pytest

from obelisk_spec.runtime_protocol import LOCAL_TRANSPORT_VARIABLE
from obk_cli.cli.rehearse import OBK as OBK_MODULE
from obk_cli.cli.rehearse import QUIETLY, rehearsal_text
from obk_cli.compiler import Options, compile_config
from obk_cli.faultinject.expectations import FAULTS, Allowances, Fault, make_cases
from obk_cli.faultinject.runner import LaunchSettings, run_cases
from obk_cli.faultinject.verdict import Verdict
from obk_cli.launch.process_groups import Unit, units_of
from obk_cli.plan.plan import OnCrash

from .stack import DEADLINE_S, DUMMY, OBK, eventually, marked, obk

pytestmark = pytest.mark.ros

PATIENT = Allowances(end_detected_s=20.0, hang_detected_s=20.0, down_s=40.0, back_s=40.0)
"""Generous limits, because only the reactions are tested, not their times on a busy machine."""
HANG_S = 5.0
"""A limit that prevents a slow node from being considered frozen."""


def units(*, together: bool = False) -> tuple[Unit, ...]:
    options = Options(variables=dict(os.environ), working_folder=DUMMY.parent)
    plan = compile_config(str(DUMMY), options).plan
    assert plan is not None
    shared = [node.full_name for node in plan.nodes] if together else []
    return units_of(plan, devices={node.device for node in plan.nodes}, together=shared)


def rehearsed(
    folder: Path,
    on_crash: OnCrash,
    faults: Sequence[Fault] = FAULTS,
    *options: str,
    nodes: Sequence[str] = (),
) -> tuple[Verdict, ...]:
    launch = (*OBK_MODULE, "launch", str(DUMMY), *QUIETLY)
    limits = (f"--hang-after={HANG_S}", f"--timeout={DEADLINE_S}")
    command = (*launch, f"--on-crash={on_crash}", *limits, *options)
    cases = make_cases(
        units(together="--composed" in options),
        faults=faults,
        on_crash=on_crash,
        nodes=nodes,
        allowances=PATIENT,
    )
    variables = {**os.environ, "OBK_HOME": str(folder)}
    return run_cases(
        cases, LaunchSettings(command=command, environment=variables, runs=folder / "runs")
    )


def are_right(verdicts: Sequence[Verdict], count: int) -> bool:
    print(rehearsal_text(verdicts))
    return len(verdicts) == count and all(verdict.is_right for verdict in verdicts)


@pytest.mark.slow
def test_with_the_rule_stop_the_stack_stops_and_names_the_node(tmp_path: Path) -> None:
    verdicts = rehearsed(tmp_path, "stop", ["freeze", "kill"], nodes=["/obelisk_estimation_0"])
    assert are_right(verdicts, 2)
    frozen, killed = (verdict.run for verdict in verdicts)
    assert killed is not None
    assert killed != frozen
    cause = "/obelisk_estimation_0: the process was terminated by SIGKILL"
    assert cause in (killed / "launch.log").read_text()
    assert not marked()


@pytest.mark.parametrize("transport", ["on", pytest.param("off", marks=pytest.mark.slow)])
def test_with_the_rule_restart_only_the_node_is_restarted(
    transport: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(LOCAL_TRANSPORT_VARIABLE, transport)
    verdicts = rehearsed(
        tmp_path, "restart", ["delay", "freeze", "kill"], nodes=["/obelisk_robot_0"]
    )
    assert are_right(verdicts, 3)
    assert len({verdict.run for verdict in verdicts}) == 1
    assert not marked()


@pytest.mark.slow
def test_with_the_rule_ignore_the_other_nodes_continue(tmp_path: Path) -> None:
    verdicts = rehearsed(tmp_path, "ignore", ["freeze", "kill"], nodes=["/obelisk_control_0"])
    assert are_right(verdicts, 2)
    assert not marked()


@pytest.mark.slow
def test_nodes_in_one_process_hang_and_recover_together(tmp_path: Path) -> None:
    assert are_right(rehearsed(tmp_path, "restart", ["freeze", "kill"], "--composed"), 2)
    assert not marked()


@pytest.mark.slow
def test_a_broken_expectation_is_reported_with_its_evidence(tmp_path: Path) -> None:
    """The cases expect a restart, but the launch stops."""
    verdicts = rehearsed(
        tmp_path, "restart", ["kill"], "--on-crash=stop", nodes=["/obelisk_robot_0"]
    )
    (verdict,) = verdicts
    assert verdict.observed.startswith("stack down")
    assert any("shut down" in fault for fault in verdict.faults)
    assert verdict.run is not None
    assert "SIGKILL" in (verdict.run / "launch.log").read_text()


@pytest.mark.slow
def test_the_command_reports_each_row_and_keeps_out_of_other_domains(
    tmp_path: Path, ros_domain: int
) -> None:
    def is_as_promised() -> bool:
        """Uses the default limits, which a busy machine may not keep, so it may run twice."""
        result = obk(
            *("rehearse", DUMMY, "--fault", "kill", "--node", "control", "--on-crash", "ignore"),
            *("--domain", ros_domain, "--format", "json"),
            env={"OBK_HOME": str(tmp_path / "home")},
        )
        reported = json.loads(result.stdout)
        (verdict,) = reported["rows"]
        assert verdict["nodes"] == ["/obelisk_control_0"]
        assert verdict["expected"] == "other nodes keep running"
        assert f"domain {ros_domain}, logs in {tmp_path}" in result.stderr
        assert result.returncode == (0 if reported["ok"] else 1)
        assert not (tmp_path / "home" / "runs").exists()
        return bool(verdict["observed"] == verdict["expected"])

    eventually(is_as_promised, "what is promised")


def test_a_rehearsal_that_is_killed_leaves_no_stack(tmp_path: Path, ros_domain: int) -> None:
    env = {**os.environ, "OBK_HOME": str(tmp_path / "home")}
    command = [OBK, "rehearse", DUMMY, "--domain", str(ros_domain)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, env=env) as process:
        eventually(lambda: nodes_below(process.pid) == 3, "the nodes")
        process.kill()
        process.wait(DEADLINE_S)
        eventually(lambda: not marked(), "the end of the nodes")


def test_a_rehearsal_that_is_interrupted_leaves_no_stack(tmp_path: Path, ros_domain: int) -> None:
    env = {**os.environ, "OBK_HOME": str(tmp_path / "home")}
    command = [OBK, "rehearse", DUMMY, "--domain", str(ros_domain)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, env=env) as process:
        eventually(lambda: nodes_below(process.pid) == 3, "the nodes")
        process.send_signal(signal.SIGINT)
        assert process.wait(DEADLINE_S) != 0
        assert process.stderr is not None
        assert b"Traceback" not in process.stderr.read()
    assert not marked()


def nodes_below(pid: int) -> int:
    children = psutil.Process(pid).children(recursive=True)
    return sum("--ros-args" in command_of(child) for child in children)


def command_of(process: psutil.Process) -> list[str]:
    try:
        return process.cmdline()
    except psutil.Error:  # has ended
        return []
