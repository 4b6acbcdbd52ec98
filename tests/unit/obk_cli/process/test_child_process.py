"""A child that does not outlive its parent, and a ROS domain that no other process uses."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import psutil
import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.process.child_process import BoundChild, run_in_foreground
from obk_cli.ros.domains import free_domain

from ....waiting import DEADLINE_S, eventually  # noqa: TID252 - shared by folders of tests


def is_there(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def test_the_output_of_a_child_is_received_line_by_line() -> None:
    lines: list[str] = []
    over = threading.Event()
    code = (
        "import sys; print('one'); sys.stdout.flush(); print('two', file=sys.stderr); sys.exit(3)"
    )
    child = BoundChild(
        [sys.executable, "-c", code], os.environ, on_line=lines.append, on_output_end=over.set
    )
    assert child.wait(DEADLINE_S) == 3
    assert over.wait(DEADLINE_S)
    child.close()
    assert lines == ["one", "two"]


def test_a_child_has_its_own_session_and_is_killed_at_the_close() -> None:
    child = BoundChild(["sleep", "60"], os.environ, on_line=print, on_output_end=lambda: None)
    assert child.exit_code is None
    assert os.getsid(child.pid) != os.getsid(0)
    child.close()
    assert child.exit_code == -signal.SIGKILL


def test_a_program_in_the_foreground_returns_its_exit_code() -> None:
    program = [sys.executable, "-c", "import sys; sys.exit(3)"]
    assert run_in_foreground(program, os.environ) == 3


WAITING = """
import sys, time
try:
    open(sys.argv[1], "w").close()
    time.sleep(1000)
except KeyboardInterrupt:
    open(sys.argv[1] + ".end", "w").close()
"""


def test_a_signal_interrupts_the_program_in_the_foreground(tmp_path: Path) -> None:
    started = tmp_path / "started"

    def end() -> None:
        eventually(started.exists, "the start of the program")
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=end).start()
    program = [sys.executable, "-c", WAITING, str(started)]
    assert run_in_foreground(program, os.environ) is None
    assert (tmp_path / "started.end").exists()


HOLDING = """
import signal, sys, time
from obk_cli.process.signals import release_interrupts
open(sys.argv[1], "w").close()
while signal.SIGINT not in signal.sigpending():
    time.sleep(0.01)
try:
    release_interrupts()
except KeyboardInterrupt:
    open(sys.argv[1] + ".end", "w").close()
"""


def test_an_interrupt_is_held_back_until_the_program_can_handle_it(tmp_path: Path) -> None:
    started = tmp_path / "started"

    def end() -> None:
        eventually(started.exists, "the start of the program")
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=end).start()
    program = [sys.executable, "-c", HOLDING, str(started)]
    assert run_in_foreground(program, os.environ, releases_interrupts=True) is None
    assert (tmp_path / "started.end").exists()


STARTER = """
import os, sys, time
from obk_cli.process.child_process import BoundChild, run_in_foreground
child = BoundChild(["sleep", "60"], os.environ, on_line=print, on_output_end=lambda: None)
while "sleep" not in open(f"/proc/{child.pid}/cmdline").read().split("\\0")[0]:
    time.sleep(0.01)
print(child.pid, flush=True)
time.sleep(60)
"""


def test_a_child_does_not_outlive_a_starter_that_is_killed(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", STARTER], stdout=subprocess.PIPE, text=True, cwd=tmp_path
    ) as starter:
        assert starter.stdout is not None
        pid = int(starter.stdout.readline())
        assert is_there(pid)
        starter.kill()
        eventually(lambda: not is_there(pid), "the end of the child")


def test_two_simultaneous_requests_get_two_domains() -> None:
    with free_domain() as one, free_domain() as other:
        assert one != other
        assert {one, other} <= set(range(1, 101))
    with free_domain() as again:
        assert again == one


def test_if_every_domain_is_in_use_it_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("obk_cli.ros.domains._is_bound", lambda *_: False)
    message = "every ROS domain from 1 to 100 is in use on this host"
    with pytest.raises(CommandFailedError, match=message), free_domain():
        pytest.fail("a domain was found")
