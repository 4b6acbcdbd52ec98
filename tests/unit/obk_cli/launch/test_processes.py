"""The warden and its client, on one-line programs: nothing outlives the client."""

import ctypes
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue

import psutil
import pytest

from obk_cli.launch import processes as processes_module
from obk_cli.launch.events import InputEvent, OutputLine, ProcessEnded, ProcessStarted
from obk_cli.launch.process_groups import Unit
from obk_cli.launch.processes import NodeCommand, WardenProcesses
from obk_cli.launch.warden_client import WardenClient, _children
from obk_cli.process import warden

from ..plans import node  # noqa: TID252 - shared by folders of tests

DEADLINE_S = 30.0


def unit(name: str) -> Unit:
    return Unit(name=f"/{name}", nodes=(node(name),))


class Bench:
    """A client, its events, and its lines."""

    def __init__(self, folder: Path, codes: dict[str, str]) -> None:
        self.received: SimpleQueue[InputEvent] = SimpleQueue()
        self.lines: SimpleQueue[OutputLine] = SimpleQueue()
        python = (sys.executable, "-I", "-S", "-c")
        self.warden = WardenClient({})
        self.processes = WardenProcesses(
            commands={
                f"/{name}": NodeCommand(arguments=(*python, code), environment={"GREETING": "hi"})
                for name, code in codes.items()
            },
            folder=folder,
            warden=self.warden,
            on_event=self.received.put,
            on_line=self.lines.put,
        )

    def close(self) -> None:
        """Stop the client."""
        self.processes.end()
        self.warden.close()

    def start(self, name: str) -> int:
        """Start a program; return its process ID."""
        self.processes.start(unit(name))
        started = self.received.get(timeout=DEADLINE_S)
        assert isinstance(started, ProcessStarted)
        return started.pid

    def line(self) -> str:
        return self.lines.get(timeout=DEADLINE_S).text

    def ended(self) -> InputEvent:
        return self.received.get(timeout=DEADLINE_S)


MakeBench = Callable[[dict[str, str]], Bench]


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[MakeBench]:
    made: list[Bench] = []

    def make(codes: dict[str, str]) -> Bench:
        made.append(Bench(tmp_path, codes))
        return made[-1]

    yield make
    for one in made:
        one.close()


def test_output_environment_folder_and_exit_code_are_passed_on(
    bench: MakeBench, tmp_path: Path
) -> None:
    code = "import os, sys; print(os.environ['GREETING'], os.getcwd()); sys.exit(3)"
    run = bench({"a": code})
    run.start("a")
    assert run.line() == f"hi {tmp_path}"
    assert run.ended() == ProcessEnded(process="/a", code=3, text=f"hi {tmp_path}")


def test_the_last_line_that_is_not_blank_is_the_reason_of_an_exit(bench: MakeBench) -> None:
    run = bench({"a": "import sys; print('x\\n  ValueError: no gain\\n\\n'); sys.exit(1)"})
    run.start("a")
    assert run.ended() == ProcessEnded(process="/a", code=1, text="ValueError: no gain")


def test_the_reason_of_an_exit_is_short(bench: MakeBench) -> None:
    run = bench({"a": "import sys; sys.stderr.write('x' * 100_000); sys.exit(1)"})
    run.start("a")
    ended = run.ended()
    assert isinstance(ended, ProcessEnded)
    assert 100 < len(ended.text) < 1000


def test_the_reason_of_an_exit_has_no_severity_time_and_logger(bench: MakeBench) -> None:
    line = "[ERROR] [1795949884.700000000] [obelisk]: no [gain]: 1"
    run = bench({"a": f"import sys; print({line!r}); sys.exit(1)"})
    run.start("a")
    assert run.ended() == ProcessEnded(process="/a", code=1, text="no [gain]: 1")


def test_the_output_of_a_process_that_has_ended_is_complete(
    bench: MakeBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes_module, "LAST_WORDS_S", DEADLINE_S)
    run = bench({"a": "print('x\\n' * 10_000)"})
    run.start("a")
    run.ended()
    run.processes.wait_for_output(["/a", "/never_started"])
    assert run.lines.qsize() == 10_001


def test_a_missing_program_is_reported_with_the_reason(bench: MakeBench) -> None:
    run = bench({})
    run.processes._commands = {"/a": NodeCommand(arguments=("/no/such",), environment={})}
    run.processes.start(unit("a"))
    ended = run.ended()
    assert isinstance(ended, ProcessEnded)
    assert ended.code == 127
    assert "it cannot start: [Errno 2] No such file or directory: '/no/such'" in ended.text


def test_a_signal_reaches_the_one_that_is_named(bench: MakeBench) -> None:
    sleep = "import time; print('up', flush=True); time.sleep(60)"
    run = bench({"a": sleep, "b": sleep})
    run.start("a")
    second = run.start("b")
    run.line()
    run.processes.signal("/a", signal.SIGTERM)
    assert run.ended() == ProcessEnded(process="/a", code=-signal.SIGTERM)
    assert psutil.pid_exists(second)


def test_children_of_a_node_end_with_it(bench: MakeBench) -> None:
    code = (
        "import subprocess, sys, time\n"
        "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
        "print(child.pid, flush=True)\n"
        "time.sleep(60)"
    )
    run = bench({"a": code})
    run.start("a")
    child = psutil.Process(int(run.line()))
    run.processes.signal("/a", signal.SIGTERM)
    run.ended()
    child.wait(DEADLINE_S)


HIDING = """
import os, subprocess, sys, time
sleep = "import time; time.sleep(600)"
between = f"import subprocess, sys; p = subprocess.Popen([sys.executable, '-c', {sleep!r}], "
between += "start_new_session=True); print(p.pid, flush=True); p.wait()"
child = subprocess.Popen([sys.executable, "-c", between], start_new_session=True)
print(child.pid, flush=True)
"""
"""Starts a child in its own session, which starts another one; prints both IDs."""


def test_children_in_their_own_sessions_end_with_their_node_only(
    bench: MakeBench,
) -> None:
    run = bench({"a": f"{HIDING}time.sleep(600)", "b": f"{HIDING}time.sleep(600)"})
    run.start("b")
    others = [psutil.Process(int(run.line())) for _ in range(2)]
    first = run.start("a")
    hidden = [psutil.Process(int(run.line())) for _ in range(2)]
    os.kill(first, signal.SIGKILL)
    assert run.ended() == ProcessEnded(process="/a", code=-signal.SIGKILL)
    _, alive = psutil.wait_procs(hidden, DEADLINE_S)
    assert not alive
    assert all(map(_is_alive, others))


SLOW_EXEC = f"""
import pathlib, runpy, time
read_bytes, loaded_at = pathlib.Path.read_bytes, {{}}
def read_late(path):
    loaded = loaded_at.setdefault(path, time.monotonic() + 0.05)
    is_early = path.name == "environ" and time.monotonic() < loaded
    return b"" if is_early else read_bytes(path)
pathlib.Path.read_bytes = read_late
runpy.run_path({warden.__file__!r}, run_name="__main__")
"""
"""The warden, with processes that take 50 ms to load their program."""


def test_a_process_that_is_still_loading_its_program_ends_with_its_node(
    bench: MakeBench, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The kernel shows an empty environment then, so its start is known only later."""
    program = tmp_path / "warden.py"
    program.write_text(SLOW_EXEC)
    monkeypatch.setattr(warden, "__file__", str(program))
    detached = "subprocess.Popen(['sleep', '600'], start_new_session=True)"
    run = bench({"a": f"import subprocess, time; print({detached}.pid, flush=True); time.sleep(9)"})
    node = run.start("a")
    hidden = psutil.Process(int(run.line()))
    os.kill(node, signal.SIGKILL)
    assert run.ended() == ProcessEnded(process="/a", code=-signal.SIGKILL)
    hidden.wait(DEADLINE_S)


def test_at_the_end_each_process_gets_one_request_and_may_end_cleanly(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A node treats a second SIGTERM as urgent, and exits immediately."""
    leader, other = 11, 12
    sent: list[tuple[str, int, int]] = []
    looks = iter([[leader, other]])

    def to_group(pid: int, number: int) -> None:
        if pid != leader:
            raise ProcessLookupError
        sent.append(("group", pid, number))

    monkeypatch.setattr("os.killpg", to_group)
    monkeypatch.setattr("os.kill", lambda pid, number: sent.append(("process", pid, number)))
    monkeypatch.setattr(warden, "_children", lambda: next(looks, []))
    here, there = socket.socketpair()
    with here, there:
        warden.Warden(here, ctypes.CDLL(None)).end_all()
    assert sent == [("group", leader, signal.SIGTERM), ("process", other, signal.SIGTERM)]


def test_nothing_outlives_the_client_not_even_children_in_their_own_session(
    bench: MakeBench,
) -> None:
    deaf = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(60)"
    code = (
        "import subprocess, sys, time\n"
        f"child = subprocess.Popen([sys.executable, '-c', {deaf!r}], start_new_session=True)\n"
        "print(child.pid, flush=True)\n"
        "time.sleep(60)"
    )
    run = bench({"a": code})
    node = psutil.Process(run.start("a"))
    hidden = psutil.Process(int(run.line()))
    run.close()
    assert not _is_alive(node)
    assert not _is_alive(hidden)


def test_a_signal_that_asks_for_the_end_is_for_the_launcher_alone(bench: MakeBench) -> None:
    """As `systemctl stop` sends it to all processes of a stack at once."""
    sleep = "import time; print('up', flush=True); time.sleep(60)"
    run = bench({"a": sleep, "b": sleep})
    first = psutil.Process(run.start("a"))
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        os.kill(run.warden.pid, number)
    run.line()
    run.start("b")
    run.line()
    assert _is_alive(first)


def test_the_loss_of_the_warden_is_reported_as_the_end_of_its_nodes(bench: MakeBench) -> None:
    run = bench({"a": "import time; time.sleep(60)"})
    node = psutil.Process(run.start("a"))
    os.kill(run.warden.pid, signal.SIGKILL)
    assert run.ended() == ProcessEnded(
        process="/a",
        code=-signal.SIGKILL,
        text="the process that watches over the nodes has exited",
    )
    node.wait(DEADLINE_S)
    run.processes.signal("/a", signal.SIGINT)
    run.processes.start(unit("a"))
    assert isinstance(run.ended(), ProcessEnded)


def test_the_loss_of_the_warden_is_reported_once_for_unstarted_processes(
    bench: MakeBench,
) -> None:
    run = bench({"a": "import time; time.sleep(60)"})
    os.kill(run.warden.pid, signal.SIGSTOP)
    run.processes.start(unit("a"))
    os.kill(run.warden.pid, signal.SIGKILL)
    assert run.ended() == ProcessEnded(
        process="/a",
        code=127,
        text="the process that watches over the nodes has exited",
    )
    run.close()
    assert run.received.empty()


def test_children_in_their_own_session_do_not_outlive_a_killed_warden(
    bench: MakeBench,
) -> None:
    code = (
        "import subprocess, sys, time\n"
        "sleep = [sys.executable, '-c', 'import time; time.sleep(60)']\n"
        "child = subprocess.Popen(sleep, start_new_session=True)\n"
        "print(child.pid, flush=True)\n"
        "time.sleep(60)"
    )
    run = bench({"a": code})
    run.start("a")
    hidden = psutil.Process(int(run.line()))
    os.kill(run.warden.pid, signal.SIGKILL)
    run.ended()
    run.close()
    assert not _is_alive(hidden)


def test_an_environment_larger_than_a_packet_is_transferred(bench: MakeBench) -> None:
    run = bench({"a": "import os; print(sum(map(len, os.environ.values())))"})
    (command,) = run.processes._commands.values()
    large = {f"LARGE_{n}": "x" * 100_000 for n in range(4)}
    run.processes._commands = {"/a": replace(command, environment=large)}
    run.start("a")
    assert int(run.line()) >= 400_000


@pytest.mark.parametrize("environment", [{"A": "b\0c"}, {"A=B": "c"}])
def test_a_program_that_cannot_start_does_not_affect_other_nodes(
    bench: MakeBench, environment: dict[str, str]
) -> None:
    run = bench({"a": "", "b": "import time; time.sleep(60)"})
    commands = dict(run.processes._commands)
    run.processes._commands = {**commands, "/a": replace(commands["/a"], environment=environment)}
    second = run.start("b")
    run.processes.start(unit("a"))
    ended = run.ended()
    assert isinstance(ended, ProcessEnded)
    assert ended.code == 127
    assert "it cannot start" in ended.text
    assert psutil.pid_exists(second)


def test_output_without_line_ends_is_split(bench: MakeBench) -> None:
    run = bench({"a": "print('x' * 200_000, end='')"})
    run.start("a")
    assert run.line() == "x" * 65536


def _is_alive(one: psutil.Process) -> bool:
    return one.is_running() and one.status() != psutil.STATUS_ZOMBIE


def test_a_process_that_can_dumps_its_stack(bench: MakeBench) -> None:
    code = (
        "import faulthandler, signal, time\n"
        "faulthandler.register(signal.SIGUSR1)\n"
        "def stuck():\n    print('up', flush=True); time.sleep(60)\n"
        "stuck()"
    )
    run = bench({"a": code})
    run.start("a")
    run.line()
    run.processes.dump_stack("/a")
    while "in stuck" not in run.line():
        pass
    assert any("in stuck" in line for line in run.processes.last_lines("/a"))


def test_a_process_that_knows_nothing_of_stacks_is_not_ended_by_the_question(
    bench: MakeBench,
) -> None:
    run = bench({"a": "import time; print('up', flush=True); time.sleep(60)"})
    pid = run.start("a")
    run.line()
    run.processes.dump_stack("/a")
    run.processes.signal("/a", signal.SIGTERM)
    assert run.ended() == ProcessEnded(process="/a", code=-signal.SIGTERM)
    assert not psutil.pid_exists(pid)


def test_a_process_can_be_started_again_under_its_name(bench: MakeBench) -> None:
    run = bench({"a": "print('hello', flush=True)"})
    for _ in range(2):
        run.start("a")
        assert run.ended() == ProcessEnded(process="/a", code=0)
        assert run.line() == "hello"
    assert run.processes.last_lines("/a") == ("hello",)


def test_of_a_process_that_is_started_early_nothing_is_reported_before_its_start(
    bench: MakeBench,
) -> None:
    one = bench({"a": "print('up'); raise SystemExit(3)", "b": "print('up')"})
    one.processes.start_early(unit("a"))
    assert one.line() == "up"
    # The second process ends after the first one, but is reported first.
    one.start("b")
    ended = one.ended()
    assert isinstance(ended, ProcessEnded)
    assert ended.process == "/b"
    assert one.received.empty()
    one.start("a")
    assert one.ended() == ProcessEnded(process="/a", code=3, text="up")
    one.start("a")  # again, as after a crash


def test_a_node_that_was_bound_to_its_warden_too_late_does_not_begin() -> None:
    """As if the warden is killed between its fork and the bond."""
    code = f"""
import ctypes, os, runpy
Warden = runpy.run_path({warden.__file__!r})["Warden"]
warden = Warden(None, ctypes.CDLL(None))
for parent in (os.getpid(), 1):
    warden._pid = parent
    child = os.fork()
    if child == 0:
        warden._in_child()
        os._exit(7)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["7", "1"]


def test_children_are_listed_while_threads_end() -> None:
    is_over = threading.Event()

    def start_threads() -> None:
        while not is_over.is_set():
            threading.Thread(target=time.sleep, args=(0.0005,)).start()

    starter = threading.Thread(target=start_threads)
    with subprocess.Popen(["sleep", "60"]) as child:
        starter.start()
        try:
            assert all(child.pid in _children() for _ in range(200))
        finally:
            is_over.set()
            starter.join()
            child.kill()
