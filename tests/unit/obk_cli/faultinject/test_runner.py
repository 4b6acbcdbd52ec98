"""The steps of a rehearsal around its cases, with launchers that are not stacks."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from obk_cli.clock import local_time
from obk_cli.errors import CommandFailedError
from obk_cli.faultinject.launched_stack import LaunchedStack
from obk_cli.faultinject.runner import (
    LaunchSettings,
    freeze,
    kill,
    make_rehearsal_folder,
    refuse_running,
    run_cases,
    thaw,
)
from obk_cli.launch.run_lock import claim_run
from obk_cli.process.identity import this_process
from obk_cli.runs.folder import Run

from ....waiting import DEADLINE_S, eventually  # noqa: TID252 - shared by folders of tests
from .made_up import case


def test_a_launch_that_fails_is_reported_with_its_message_and_repeated(tmp_path: Path) -> None:
    refuse = "import sys; print('error: no room', file=sys.stderr); sys.exit(1)"
    settings = LaunchSettings(
        command=(sys.executable, "-c", refuse), environment=dict(os.environ), runs=tmp_path
    )
    begun: list[str] = []
    verdicts = run_cases(
        [case("kill", "stop"), case("freeze", "stop")], settings, lambda c: begun.append(c.fault)
    )
    assert begun == ["kill", "freeze"]
    assert [verdict.observed for verdict in verdicts] == ["not tried", "not tried"]
    assert verdicts[0].faults[0].endswith("error: no room")


def test_a_finished_launcher_is_waited_for(tmp_path: Path) -> None:
    leave = "import os, time; os.close(1); os.close(2); time.sleep(0.3); os._exit(1)"
    stack = LaunchedStack((sys.executable, "-c", leave), dict(os.environ), tmp_path)
    assert not stack.wait_until(lambda _: False, 20.0)
    assert stack.over_s is not None
    assert stack.outcome(20.0) == 1
    stack.end(0.0)


def test_a_launcher_that_may_still_report_is_not_waited_for(tmp_path: Path) -> None:
    stack = LaunchedStack(("sleep", "60"), dict(os.environ), tmp_path)
    assert stack.outcome(20.0) is None
    stack.end(0.0)


def test_a_running_stack_is_rejected_with_its_process(tmp_path: Path) -> None:
    pid, started = this_process()
    run = Run(name="s", pid=pid, started=started, domain=7, config="c.yaml", nodes=("/a",))
    claim_run(tmp_path, run, local_time())
    refuse_running(tmp_path, "another")
    with pytest.raises(CommandFailedError, match=rf"domain 7 .*{pid}") as refused:
        refuse_running(tmp_path, "s")
    assert refused.value.help == "stop it with `obk stop s`"


def test_ten_rehearsals_keep_their_logs(tmp_path: Path) -> None:
    first, *later = [make_rehearsal_folder(tmp_path, "s") for _ in range(11)]
    assert not first.exists()
    assert all(home.exists() for home in later)


def test_without_a_log_folder_nothing_is_rehearsed(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(CommandFailedError, match="cannot be created") as raised:
        make_rehearsal_folder(tmp_path / "file", "s")
    assert "OBK_HOME" in str(raised.value.help)


def stopped(*processes: psutil.Process) -> int:
    """The number of running launchers."""
    return sum(process.status() == psutil.STATUS_STOPPED for process in processes)


def test_a_process_freezes_thaws_and_dies_with_its_children() -> None:
    with subprocess.Popen(["sh", "-c", "sleep 60 & wait"], start_new_session=True) as shell:
        family = psutil.Process(shell.pid)
        eventually(family.children, "the grandchild")
        (grandchild,) = family.children()
        both = (family, grandchild)
        try:
            freeze(shell.pid)
            eventually(lambda: stopped(*both) == 2, "that both are frozen")
            thaw(shell.pid)
            eventually(lambda: stopped(*both) == 0, "that both run")
        finally:
            kill(shell.pid)
            grandchild.kill()
        assert shell.wait(DEADLINE_S) == -signal.SIGKILL
        for stroke in (freeze, thaw, kill):
            stroke(shell.pid)  # has already ended
