"""Shared code for the tests of running stacks: a driver of one node, and runs of obk."""

import atexit
import gc
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import psutil
import rclpy
from lifecycle_msgs.srv import ChangeState
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future

from obelisk_py.core.lifecycle import GuardedLifecycleNode

from ..waiting import DEADLINE_S, eventually  # noqa: TID252 - shared by folders of tests

OBK = Path(sys.executable).with_name("obk")
LIMITS = {
    "launch": {"--timeout": str(DEADLINE_S), "--hang-after": "20"},
    **{
        word: {"--timeout": str(DEADLINE_S)}
        for word in ("node", "param", "service", "stop", "topic")
    },
}
"""First word of a command -> the timeout options, with generous values."""
N = TypeVar("N", bound=Node)
MARK = "OBELISK_TEST_RUN"
"""The variable by which the `ros_domain` fixture finds a test's processes."""


def calm(folder: Path) -> None:
    """Change the configs in a folder to 10 Hz, which a busy machine can keep."""
    for config in folder.glob("*.yaml"):
        text = config.read_text()
        config.write_text(re.sub(r"\b(timer_period_sec|dt): 0\.00\d+", r"\1: 0.1", text))


def _calm_copy(example: Path) -> Path:
    folder = tempfile.TemporaryDirectory(prefix="obelisk-dummy-")
    atexit.register(folder.cleanup)
    copy = Path(folder.name, example.parent.name)
    shutil.copytree(example.parent, copy)
    calm(copy)
    return copy / example.name


EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "dummy" / "dummy.yaml"
DUMMY = _calm_copy(EXAMPLE)
"""The example at 10 Hz; at 1000 Hz a stack uses one of two cores."""


def parameters(**values: str) -> dict[str, Any]:
    """Keyword arguments for a node with these parameters."""
    return {"parameter_overrides": [Parameter(name, value=value) for name, value in values.items()]}


@contextmanager
def spinning(
    make: Callable[[], N], make_executor: Callable[[], Executor] = SingleThreadedExecutor
) -> Iterator[N]:
    """A node that spins in a thread, in its own context."""
    rclpy.init()
    node, executor = make(), make_executor()
    executor.add_node(node)
    over = Future()
    spin = executor.spin_until_future_complete
    thread = threading.Thread(target=spin, args=[over], daemon=True)
    thread.start()
    try:
        yield node
    finally:
        # If shut down while it spins, an rclpy executor may fail on entities just released.
        over.set_result(None)
        thread.join()
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
        # A lifecycle node is part of reference cycles, and stays in the ROS graph until they are
        # collected; an executor that spun keeps references to its last nodes.
        del node, executor, spin, thread
        gc.collect()


def request(node: GuardedLifecycleNode, label: str = "", number: int = 0) -> bool:
    """Call the node's change_state on the thread that spins it, like its service would."""
    call = ChangeState.Request()
    call.transition.label, call.transition.id = label, number
    change = node._service_change_state.callback
    if node.executor is None:
        return bool(change(call, ChangeState.Response()).success)
    done = threading.Event()
    task = node.executor.create_task(change, call, ChangeState.Response())
    task.add_done_callback(lambda _: done.set())
    assert done.wait(DEADLINE_S), f"no answer to {label or number}"
    return bool(task.result().success)


def patient(*words: object) -> list[str]:
    """A command with limits that a busy machine can keep; tests of the limits set their own."""
    given = list(map(str, words))
    limits = LIMITS.get(given[0], {}) if given else {}
    missing = (limit for limit in limits.items() if limit[0] not in given)
    return [*given, *(word for limit in missing for word in limit)]


def obk(
    *arguments: object,
    timeout_s: float = 2 * DEADLINE_S,
    env: Mapping[str, str] | None = None,
    folder: Path | None = None,
    is_patient: bool = True,
) -> subprocess.CompletedProcess[str]:
    """Run obk until it ends, with additional variables, in a folder (None: the current one)."""
    return subprocess.run(
        cwd=folder,
        args=[OBK, *(patient(*arguments) if is_patient else map(str, arguments))],
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
        env={**os.environ, **(env or {})},
    )


@contextmanager
def launched(config: Path, *options: object, phase: str = "active") -> Iterator["Launched"]:
    """A stack that has reached a phase; stopped by SIGINT at the end."""
    with started(config, *options) as run:
        run.wait_for(phase)
        yield run


@contextmanager
def started(config: Path, *options: object) -> Iterator["Launched"]:
    """A stack that is starting; stopped by SIGINT at the end."""
    process = subprocess.Popen(
        [OBK, *patient("launch", config, *options)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    run = Launched(process)
    try:
        yield run
    finally:
        if process.poll() is None:
            process.send_signal(2)
        process.wait(DEADLINE_S)
        run.reader.join()


class Launched:
    """A running `obk launch` and its output so far."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self.process = process
        self.lines: list[str] = []
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()
        self.descendants: set[psutil.Process] = set()

    @property
    def text(self) -> str:
        """The whole output."""
        return "\n".join(self.lines)

    @property
    def cause(self) -> str:
        """The line that reports why the run failed; empty if it did not."""
        return next((line for line in self.lines if line.startswith("failed: ")), "")

    def wait_for(self, phase: str) -> None:
        """Wait for a phase line, and record every process below the launcher."""
        eventually(
            lambda: any(f"s] {phase}" in line for line in self.lines) or self._has_ended(),
            f"the phase {phase}",
            seen=lambda: self.text,
        )
        assert not self._has_ended(), self.text
        self.descendants |= set(psutil.Process(self.process.pid).children(recursive=True))

    def wait_for_line(self, part: str, deadline_s: float = DEADLINE_S) -> None:
        """Wait for a line with this text."""

        def is_shown() -> bool:
            return any(part in line for line in self.lines)

        def is_over() -> bool:
            return is_shown() or not self.reader.is_alive()

        eventually(is_over, part, seen=lambda: self.text, deadline_s=deadline_s)
        assert is_shown(), self.text

    def node(self, name: str) -> psutil.Process:
        """The process of a node."""
        argument = f"__node:={name}"
        return next(p for p in self.descendants if argument in arguments_of(p))

    def left_over(self) -> list[psutil.Process]:
        """Processes of the stack that are still running, except zombies."""
        return [p for p in self.descendants if _is_there(p)]

    def _has_ended(self) -> bool:
        return self.process.poll() is not None

    def _read(self) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as output:
            for line in output:
                self.lines.append(line.rstrip("\n"))


def marked() -> list[psutil.Process]:
    """Processes other than this one that have this test's mark in their environment."""
    return [p for p in psutil.process_iter() if p.pid != os.getpid() and _is_marked(p)]


def arguments_of(process: psutil.Process) -> list[str]:
    """The command line of a process; empty if it has ended, as a short-lived child may have."""
    try:
        return process.cmdline()
    except psutil.Error:
        return []


def _is_marked(process: psutil.Process) -> bool:
    try:
        return process.environ().get(MARK) == os.environ[MARK]
    except psutil.Error:  # has ended, or belongs to another user
        return False


def _is_there(process: psutil.Process) -> bool:
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
