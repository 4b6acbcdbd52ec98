"""`obk doctor` on the machine of the tests."""

import json
import os
import re
import subprocess
from pathlib import Path

import pytest

from .stack import OBK, eventually, marked, obk
from .user_shell import user_shell

pytestmark = pytest.mark.ros


def test_the_machine_that_tests_run_on_has_no_errors() -> None:
    result = obk("doctor", "--format", "json")
    reported = json.loads(result.stdout)
    errors = [finding for finding in reported["findings"] if finding["severity"] == "error"]
    assert (result.returncode, errors) == (0, [])
    assert not [f for f in reported["findings"] if "the check itself failed" in f["message"]]
    discovery = next(f for f in reported["findings"] if f["check"] == "discovery")
    assert discovery["facts"]["rmw"] == "rmw_fastrtps_cpp"
    assert discovery["facts"]["first_answer_s"] > 0


def test_every_check_of_the_list_can_be_selected_alone() -> None:
    names = [line.split()[0] for line in obk("doctor", "--list").stdout.splitlines()]
    assert len(names) == len(set(names))
    result = obk("doctor", *(name for name in names if name not in ("discovery", "mujoco")))
    assert result.returncode == 0, result.stdout


def test_a_terminal_shows_the_running_checks_and_then_only_the_findings(
    tmp_path: Path,
) -> None:
    variables = {name: value for name, value in os.environ.items() if name != "NO_COLOR"}
    with user_shell(tmp_path, variables) as shell:
        shell.type(f"{OBK} doctor discovery stacks\n")
        shell.wait_for(re.compile(r"1 of 2 checks; running: discovery"))
        assert shell.wait_for_prompt() == 0
        assert "discovery " in shell.seen.rpartition("still at it")[2]


def test_a_doctor_that_is_killed_leaves_no_process_behind() -> None:
    doctor = subprocess.Popen([OBK, "doctor", "discovery"], stdout=subprocess.DEVNULL)
    eventually(lambda: len(marked()) == 3, "the doctor and the two that look for each other")
    doctor.kill()
    doctor.wait()
    eventually(lambda: not marked(), "the end of what it had started")
