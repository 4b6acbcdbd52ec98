"""Leftovers of stacks: found by their environment, terminated with all their children."""

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from obk_cli.process.identity import launch_marks, start_s, this_process
from obk_cli.runs import orphans as leftovers
from obk_cli.runs.folder import Run, write_run
from obk_cli.runs.orphans import end_orphans, find_orphans

from ....turns import turn_of_leftovers  # noqa: TID252 - shared by folders of tests
from ....waiting import DEADLINE_S  # noqa: TID252

PID, STARTED = this_process()
GONE = f"{PID}:{STARTED - 60}"
RUN = f"dummy_20310203_{os.getpid():06}"
WAIT = "import sys; print(flush=True); sys.stdin.read()"
IGNORE = f"import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); {WAIT}"
WITH_CHILD = (
    "import subprocess, sys; "
    f"child = subprocess.Popen([sys.executable, '-I', '-S', '-c', {WAIT!r}], env={{}}, "
    "start_new_session=True, stdout=subprocess.PIPE); "
    "child.stdout.readline(); print(child.pid, flush=True); sys.stdin.read()"
)

BREEDING = f"""
import os, signal, subprocess, sys
def breed(*_):
    child = subprocess.Popen([sys.executable, '-I', '-S', '-c', {WAIT!r}], env={{}},
        start_new_session=True, stdout=subprocess.DEVNULL)
    os.write(1, b'%d\\n' % child.pid)  # it may be within another write
signal.signal(signal.SIGTERM, breed)
os.write(1, b'\\n')
while True:
    signal.pause()
"""
"""A child that it starts at shutdown does not exist during the scan."""


@pytest.fixture(autouse=True)
def turn() -> Iterator[None]:
    with turn_of_leftovers():
        yield


@contextmanager
def running(code: str, marks: Mapping[str, str]) -> Iterator["subprocess.Popen[str]"]:
    """A running process in its own session."""
    with subprocess.Popen(
        [sys.executable, "-I", "-S", "-c", code],
        env=dict(marks),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def test_a_process_whose_launcher_has_ended_is_found(tmp_path: Path) -> None:
    with running(WAIT, {"OBK_RUN": RUN, "OBK_LAUNCHER": GONE}) as process:
        assert process.stdout is not None
        process.stdout.readline()
        (found,) = find_orphans(tmp_path, run=RUN)
        assert (found.pid, found.run, found.started) == (process.pid, RUN, start_s(process.pid))
        assert found.command.startswith(sys.executable)
        assert not find_orphans(tmp_path, run="another")


def test_a_process_whose_launcher_is_running_is_no_orphan(tmp_path: Path) -> None:
    marks = launch_marks(tmp_path / RUN)
    assert marks == {"OBK_RUN": RUN, "OBK_LAUNCHER": f"{PID}:{STARTED}"}
    with running(WAIT, marks) as process:
        assert process.stdout is not None
        process.stdout.readline()
        assert not find_orphans(tmp_path, run=RUN)


@pytest.mark.parametrize("mark", [{}, {"OBK_LAUNCHER": "nonsense"}])
def test_without_the_launchers_number_the_run_file_is_used(
    tmp_path: Path, mark: Mapping[str, str]
) -> None:
    (tmp_path / RUN).mkdir()
    run = Run(name="dummy", pid=PID, started=STARTED - 60, domain=1, config="c", nodes=())
    with running(WAIT, {"OBK_RUN": RUN, **mark}) as process:
        assert process.stdout is not None
        process.stdout.readline()
        assert not find_orphans(tmp_path, run=RUN)  # its owner is unknown
        write_run(tmp_path / RUN, run)
        assert [left.pid for left in find_orphans(tmp_path, run=RUN)] == [process.pid]


def test_a_run_without_a_folder_is_unrecorded() -> None:
    assert launch_marks(None)["OBK_RUN"] == "unrecorded"


def test_an_orphan_is_ended_with_its_children_in_their_own_sessions(tmp_path: Path) -> None:
    with running(WITH_CHILD, {"OBK_RUN": RUN, "OBK_LAUNCHER": GONE}) as process:
        assert process.stdout is not None
        grandchild = int(process.stdout.readline())
        assert not end_orphans(find_orphans(tmp_path, run=RUN))
        assert process.wait(DEADLINE_S) != 0
        assert not psutil.pid_exists(grandchild) or start_s(grandchild) is None


def test_one_that_ignores_sigterm_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("obk_cli.runs.orphans.GRACE_S", 0.05)
    with running(IGNORE, {"OBK_RUN": RUN, "OBK_LAUNCHER": GONE}) as process:
        assert process.stdout is not None
        process.stdout.readline()
        assert not end_orphans(find_orphans(tmp_path, run=RUN))
        assert process.wait(DEADLINE_S) == -9


def test_processes_started_during_the_scan_are_ended_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("obk_cli.runs.orphans.GRACE_S", 0.5)
    with running(BREEDING, {"OBK_RUN": RUN, "OBK_LAUNCHER": GONE}) as process:
        assert process.stdout is not None
        process.stdout.readline()
        assert not end_orphans(find_orphans(tmp_path, run=RUN))
        assert start_s(int(process.stdout.readline())) is None


def test_the_reaping_process_itself_is_spared(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; "
        "from obk_cli.runs.orphans import find_orphans; "
        f"print(len(find_orphans(Path(sys.argv[1]), run={RUN!r})))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code, tmp_path],
        env={**os.environ, "OBK_RUN": RUN, "OBK_LAUNCHER": GONE},
        capture_output=True,
        text=True,
        check=True,
    )
    assert result.stdout == "0\n"


def test_processes_in_a_container_are_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with running(WAIT, {"OBK_RUN": RUN, "OBK_LAUNCHER": GONE}) as process:
        assert process.stdout is not None
        process.stdout.readline()
        monkeypatch.setattr(leftovers, "shares_pid_namespace", lambda pid: pid != process.pid)
        assert not find_orphans(tmp_path, run=RUN)
