"""Stopping a launcher, with a sleeping process instead."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from obk_cli.launch.control_server import serve_control
from obk_cli.launch.events import StopRequested
from obk_cli.process.identity import start_s
from obk_cli.runs import registry
from obk_cli.runs.folder import Run, write_run
from obk_cli.runs.protocol import ANSWER_S
from obk_cli.runs.registry import end_launcher

from ....waiting import DEADLINE_S  # noqa: TID252 - shared by folders of tests

WAIT = "import time; print(flush=True); time.sleep(60)"
IGNORE = f"import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); {WAIT}"


@contextmanager
def launcher(code: str, folder: Path) -> Iterator[tuple["subprocess.Popen[str]", Run]]:
    with subprocess.Popen(
        [sys.executable, "-I", "-S", "-c", code], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        started = start_s(process.pid)
        assert started is not None
        run = Run(name="s", pid=process.pid, started=started, domain=1, config="c", nodes=("/a",))
        write_run(folder, run)
        try:
            yield process, run
        finally:
            process.kill()


def test_a_launcher_without_a_socket_gets_sigint(tmp_path: Path) -> None:
    with launcher(WAIT, tmp_path) as (process, run):
        assert end_launcher(tmp_path, run, reason="test") == "ended"
        assert process.wait(DEADLINE_S) == -signal.SIGINT


def test_a_stopped_launcher_is_continued_until_it_ends(tmp_path: Path) -> None:
    with launcher(WAIT, tmp_path) as (process, run):
        process.send_signal(signal.SIGSTOP)
        assert end_launcher(tmp_path, run, reason="test", timeout_s=DEADLINE_S) == "ended"
        assert process.wait(DEADLINE_S) == -signal.SIGINT


def test_a_launcher_that_does_not_end_is_left_or_killed_as_requested(tmp_path: Path) -> None:
    with launcher(IGNORE, tmp_path) as (process, run):
        assert end_launcher(tmp_path, run, reason="test", timeout_s=0.01) == "running"
        assert process.poll() is None
        assert end_launcher(tmp_path, run, reason="test", timeout_s=0.01, may_kill=True) == "killed"
        assert process.wait(DEADLINE_S) == -signal.SIGKILL


def test_a_launcher_that_replies_is_requested_and_not_signaled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, "EXIT_S", 0.0)
    received = []

    with launcher(WAIT, tmp_path) as (process, run):

        def receive(asked: object) -> None:
            received.append(asked)
            write_run(tmp_path, replace(run, ended=1.0))

        with serve_control(tmp_path, receive):
            assert end_launcher(tmp_path, run, reason="test") == "ended"
        assert received == [StopRequested(reason="test")]
        assert process.poll() is None


def test_a_launcher_that_is_slow_to_answer_is_not_hurried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, "EXIT_S", 0.0)
    sent: list[tuple[float, ...]] = []

    with launcher(WAIT, tmp_path) as (_, run):

        def answer_in_5_s(folder: Path, _reason: str, timeout_s: float = ANSWER_S) -> bool:
            write_run(folder, replace(run, ended=1.0))
            return timeout_s >= 5

        monkeypatch.setattr(registry, "ask_stop", answer_in_5_s)
        monkeypatch.setattr(registry, "signal_process", lambda *signalled: sent.append(signalled))
        assert end_launcher(tmp_path, run, reason="test") == "ended"
        assert [number for *_, number in sent] == [signal.SIGCONT]


def test_another_process_with_the_same_id_is_left_alone(tmp_path: Path) -> None:
    with launcher(WAIT, tmp_path) as (process, run):
        other = replace(run, started=run.started - 60)
        write_run(tmp_path, other)
        assert end_launcher(tmp_path, other, reason="test") == "ended"
        assert process.poll() is None
