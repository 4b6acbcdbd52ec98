"""Processes forked by the preload server behave like ordinary processes."""

import json
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from queue import SimpleQueue

import psutil
import pytest

from obk_cli.launch import preloading
from obk_cli.launch.events import InputEvent, OutputLine, ProcessEnded, ProcessStarted
from obk_cli.launch.preloading import Preload
from obk_cli.launch.process_groups import Unit
from obk_cli.launch.processes import NodeCommand, WardenProcesses
from obk_cli.launch.warden_client import WardenClient, shareable
from obk_cli.process import preload

from ....waiting import DEADLINE_S, eventually  # noqa: TID252 - shared by folders of tests
from ..plans import node  # noqa: TID252

LOADED = "xmlrpc.client"
"""A module that only the servers of these tests import."""
FORKED = f"import sys; print('{LOADED}' in sys.modules, flush=True)\n"
ALIKE = """
import ctypes, gc, json, os, signal, sys
death = ctypes.c_int()
ctypes.CDLL(None).prctl(2, ctypes.byref(death))
def proc(name):
    return open(f"/proc/self/{name}", "rb").read().decode()
print(json.dumps({
    "argv": sys.argv, "orig_argv": sys.orig_argv, "name": __name__, "path": sys.path,
    "main": sys.modules["__main__"].__dict__ is globals(), "globals": sorted(globals()),
    "flags": list(sys.flags), "cwd": os.getcwd(),
    "environment": {k: v for k, v in os.environ.items() if k != "OBK_START"},
    "cmdline": proc("cmdline"), "comm": proc("comm"),
    "environ": sorted(v for v in proc("environ").split("\\0") if not v.startswith("OBK_START=")),
    "mark": f"OBK_START={os.environ['OBK_START']}" in proc("environ").split("\\0"),
    "leads": [os.getsid(0) == os.getpid(), os.getpgid(0) == os.getpid()],
    "death": death.value, "signals": [str(signal.getsignal(n)) for n in range(1, 32)],
    "mask": [int(n) for n in signal.pthread_sigmask(signal.SIG_BLOCK, [])],
    "descriptors": sorted(os.listdir("/proc/self/fd"))[:-1],
    "files": [os.readlink("/proc/self/fd/0"), os.path.sameopenfile(1, 2)],
    "buffers": [sys.stdout.line_buffering, sys.stderr.line_buffering, sys.stdout.encoding],
    "threads": len(os.listdir("/proc/self/task")), "limits": proc("limits"),
    "collects": gc.isenabled(),
}), flush=True)
"""


def unit(name: str) -> Unit:
    return Unit(name=f"/{name}", nodes=(node(name),))


def python(code: str, *arguments: str) -> tuple[str, ...]:
    return (sys.executable, "-P", "-c", code, *arguments)


class Bench:
    """A client with or without a server, its events, and its lines."""

    def __init__(
        self,
        folder: Path,
        programs: Mapping[str, tuple[str, ...]],
        *,
        is_forked: bool = True,
        added: Mapping[str, str] | None = None,
        inherited: Mapping[str, tuple[int, ...]] | None = None,
    ) -> None:
        self.received: SimpleQueue[InputEvent] = SimpleQueue()
        self.lines: SimpleQueue[OutputLine] = SimpleQueue()
        # Coverage would import modules, and SHLVL differs in nested shells.
        variables = {k: v for k, v in os.environ.items() if not k.startswith(("COV", "PYTEST"))}
        self.variables = variables
        self.warden = WardenClient({}, Preload(environment=variables) if is_forked else None)
        self.processes = WardenProcesses(
            commands={
                f"/{name}": NodeCommand(
                    arguments=program,
                    in_python=program,
                    environment={**variables, **(added or {})},
                    inherited=(inherited or {}).get(name, ()),
                )
                for name, program in programs.items()
            },
            folder=folder,
            warden=self.warden,
            on_event=self.received.put,
            on_line=self.lines.put,
        )

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

    def server(self) -> psutil.Process:
        """The preload server."""
        warden = psutil.Process(self.warden.pid)
        found: list[psutil.Process] = []

        def is_there() -> bool:
            found[:] = [p for p in warden.children() if preload.__file__ in p.cmdline()]
            return bool(found)

        eventually(is_there, "the preload server")
        return found[0]


MakeBench = Callable[..., Bench]


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[MakeBench]:
    monkeypatch.setattr(preloading, "MODULES", (LOADED,))
    made: list[Bench] = []

    def make(programs: Mapping[str, tuple[str, ...]], **options: object) -> Bench:
        made.append(Bench(tmp_path, programs, **options))  # type: ignore[arg-type]
        return made[-1]

    yield make
    for one in made:
        one.processes.end()
        one.warden.close()


@pytest.fixture
def library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder from which all processes import."""
    folder = tmp_path / "common_library"
    folder.mkdir()
    path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    monkeypatch.setenv("PYTHONPATH", path)
    return folder


def _is_alive(process: psutil.Process) -> bool:
    return process.is_running() and process.status() != psutil.STATUS_ZOMBIE


def test_a_forked_process_is_as_one_that_was_started(bench: MakeBench, tmp_path: Path) -> None:
    (tmp_path / "library").mkdir()
    added = {"PYTHONPATH": f"{tmp_path}/library", "OBK_MORE": "yes"}
    if "PYTHONPATH" in os.environ:
        added["PYTHONPATH"] += f":{os.environ['PYTHONPATH']}"
    own, other = map(shareable, os.pipe())
    reported = []
    for is_forked in (True, False):
        programs = {"a": python(f"{FORKED}{ALIKE}", "--ros-args", "x y")}
        run = bench(
            {**programs, "b": python("")},
            is_forked=is_forked,
            added=added,
            inherited={"a": (own,), "b": (other,)},
        )
        run.start("a")
        assert run.line() == str(is_forked)
        reported.append(json.loads(run.line()))
        assert run.ended() == ProcessEnded(process="/a", code=0)
    for number in (own, other):
        os.close(number)
    assert reported[0] == reported[1]
    assert reported[0]["mark"]


def test_a_server_started_early_forks_with_what_it_gets_later(
    bench: MakeBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = bench({"a": python(FORKED)}, added={"OBK_RUN": "1", "AMENT_PREFIX_PATH": "/prefix"})
    server = run.server()
    run.warden.use_preload(Preload(environment={**run.variables, "OBK_RUN": "1"}))
    run.start("a")
    assert run.line() == "True"
    assert run.server() == server


def test_a_server_with_another_environment_is_replaced(bench: MakeBench) -> None:
    added = {"LD_LIBRARY_PATH": "/overlay"}
    read_fd, write_fd = map(shareable, os.pipe())
    code = f"{FORKED}import os; os.write({write_fd}, b'x')"
    run = bench({"a": python(code)}, added=added, inherited={"a": (write_fd,)})
    first = run.server()
    run.warden.use_preload(Preload(environment={**run.variables, **added}))
    run.processes._preload = run.warden.preload
    run.start("a")
    assert run.line() == "True"
    assert os.read(read_fd, 1) == b"x"
    assert not first.is_running()
    for number in (read_fd, write_fd):
        os.close(number)


def test_a_server_that_no_process_needs_is_ended(bench: MakeBench) -> None:
    run = bench({"a": python(FORKED)})
    first = run.server()
    run.warden.use_preload(None)
    run.processes._preload = run.warden.preload
    run.start("a")
    assert run.line() == "False"
    eventually(lambda: not first.is_running(), "the end of the server")


@pytest.mark.parametrize(
    ("code", "exit_code"),
    [
        ("sys.exit(3)", 3),
        ("sys.exit('a text')", 1),
        ("def f():\n    raise ValueError('boom')\nf()", 1),
        ("raise KeyboardInterrupt", -signal.SIGINT),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", -signal.SIGSEGV),
        ("import os; os._exit(5)", 5),
        ("import atexit; atexit.register(print, 'the end')", 0),
        ("import threading; threading.Timer(0.1, print, ['late']).start()", 0),
    ],
)
def test_it_ends_as_one_that_was_started(bench: MakeBench, code: str, exit_code: int) -> None:
    ends = []
    for is_forked in (True, False):
        run = bench({"a": python(f"{FORKED}{code}")}, is_forked=is_forked)
        run.start("a")
        ended = run.ended()
        assert isinstance(ended, ProcessEnded)
        assert ended.code == exit_code
        run.processes.end()
        assert run.line() == str(is_forked)
        ends.append(
            (ended.text if exit_code else "", [run.line() for _ in range(run.lines.qsize())])
        )
    (forked, started) = ends
    assert forked[1] == started[1]


def test_a_module_is_run_as_the_program(bench: MakeBench, tmp_path: Path) -> None:
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "__main__.py").write_text(
        f"{FORKED}print(__name__, __package__, __spec__.name, sys.argv)\nraise SystemExit(2)\n"
    )
    reported = []
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    for is_forked in (True, False):
        program = (sys.executable, "-P", "-m", "package", "-x")
        run = bench({"a": program}, is_forked=is_forked, added={"PYTHONPATH": path})
        run.start("a")
        assert run.line() == str(is_forked)
        reported.append(run.line())
        ended = run.ended()
        assert isinstance(ended, ProcessEnded)
        assert ended.code == 2
    assert reported[0] == reported[1]


def test_forked_processes_share_no_random_numbers(bench: MakeBench) -> None:
    code = f"{FORKED}import random; print(random.random())"
    run = bench({"a": python(code), "b": python(code)})
    numbers = set()
    for name in ("a", "b"):
        run.start(name)
        assert run.line() == "True"
        numbers.add(run.line())
        run.ended()
    assert len(numbers) == 2


@pytest.mark.parametrize("name", ["xmlrpc", "sitecustomize.py"])
def test_a_node_with_different_imports_is_not_forked(
    bench: MakeBench, tmp_path: Path, name: str
) -> None:
    library = tmp_path / "library"
    library.mkdir()
    if name.endswith(".py"):
        (library / name).touch()
    else:
        (library / name).mkdir()
        (library / name / "__init__.py").touch()
    path = os.pathsep.join([str(library), *filter(None, [os.environ.get("PYTHONPATH")])])
    run = bench({"a": python(FORKED)}, added={"PYTHONPATH": path})
    run.start("a")
    assert run.line() == "False"


def test_a_node_with_its_own_variable_is_not_forked(bench: MakeBench) -> None:
    run = bench({"a": python(FORKED)}, added={"OMP_NUM_THREADS": "1"})
    run.start("a")
    assert run.line() == "False"


def test_nodes_outlive_the_server_and_others_start_without_it(bench: MakeBench) -> None:
    code = f"{FORKED}import time; time.sleep(600)"
    run = bench({"a": python(code), "b": python(code)})
    first = psutil.Process(run.start("a"))
    assert run.line() == "True"
    run.server().kill()
    run.start("b")
    assert run.line() == "False"
    assert _is_alive(first)
    run.processes.signal("/a", signal.SIGTERM)
    assert run.ended() == ProcessEnded(process="/a", code=-signal.SIGTERM)


@pytest.mark.parametrize("is_ended", [False, True])
def test_a_server_that_hangs_is_ended_and_done_without(bench: MakeBench, is_ended: bool) -> None:
    sleep = "import time; time.sleep(600)"
    run = bench({"a": python(f"{FORKED}{sleep}"), "b": python(f"{FORKED}{sleep}")})
    run.start("a")
    assert run.line() == "True"
    run.server().suspend()
    run.processes.start(unit("b"))
    if is_ended:
        run.processes.signal("/b", signal.SIGTERM)
    assert isinstance(run.ended(), ProcessStarted)
    if is_ended:
        assert run.ended() == ProcessEnded(process="/b", code=-signal.SIGTERM)
    else:
        assert run.line() == "False"


def test_a_server_that_breaks_down_at_its_imports_forks_nothing(
    bench: MakeBench, library: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (library / "broken.py").write_text("raise RuntimeError('broken')")
    monkeypatch.setattr(preloading, "MODULES", ("broken",))
    run = bench({"a": python(FORKED)})
    run.start("a")
    assert run.line() == "False"


def test_a_server_skips_missing_modules(bench: MakeBench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(preloading, "MODULES", ("no_such_module", LOADED))
    run = bench({"a": python(FORKED)})
    run.start("a")
    assert run.line() == "True"


def test_a_node_that_waits_for_the_server_can_be_ended(
    bench: MakeBench, library: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (library / "slow_to_import.py").write_text("import time; time.sleep(600)")
    monkeypatch.setattr(preloading, "MODULES", ("slow_to_import",))
    run = bench({"a": python(FORKED), "b": python("")})
    run.processes.start(unit("a"))
    run.processes.signal("/a", signal.SIGTERM)
    assert run.ended() == ProcessEnded(process="/a", code=-signal.SIGTERM)
    server = run.server()
    run.processes.end()
    assert run.lines.empty()
    assert not _is_alive(server)


@pytest.mark.parametrize("who", ["warden", "server and warden"])
def test_no_forked_process_outlives_a_killed_warden(bench: MakeBench, who: str) -> None:
    run = bench({"a": python(f"{FORKED}import time; time.sleep(600)")})
    forked = psutil.Process(run.start("a"))
    assert run.line() == "True"
    server = run.server()
    if "server" in who:
        server.kill()
    os.kill(run.warden.pid, signal.SIGKILL)
    assert isinstance(run.ended(), ProcessEnded)
    for process in (forked, server):
        process.wait(DEADLINE_S)


def test_children_of_a_forked_process_in_their_own_session_end_with_it(
    bench: MakeBench,
) -> None:
    code = (
        "import os, time\n"
        "if os.fork() == 0:\n"
        "    os.setsid(); print(os.getpid(), flush=True)\n"
        "time.sleep(600)"
    )
    run = bench({"a": python(code), "b": python(code)})
    first, second = (psutil.Process(run.start(name)) for name in ("a", "b"))
    hidden = {psutil.Process(int(run.line())) for _ in range(2)}
    of_first = next(p for p in hidden if p.ppid() == first.pid)
    (of_second,) = hidden - {of_first}
    os.kill(first.pid, signal.SIGKILL)
    assert run.ended() == ProcessEnded(process="/a", code=-signal.SIGKILL)
    of_first.wait(DEADLINE_S)
    assert _is_alive(of_second)
    assert _is_alive(second)


def test_a_process_can_be_forked_again_under_its_name(bench: MakeBench) -> None:
    run = bench({"a": python(FORKED)})
    for _ in range(3):
        run.start("a")
        assert run.line() == "True"
        assert run.ended() == ProcessEnded(process="/a", code=0)
