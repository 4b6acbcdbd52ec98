"""What the tests of running stacks share: a driver of one node in this process, and obk's runs."""

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
"""First word of a command -> the options that say how long others may take, with time enough."""
N = TypeVar("N", bound=Node)
MARK = "OBELISK_TEST_RUN"
"""The variable by which the fixture `ros_domain` knows a test's processes."""


def calm(folder: Path) -> None:
    """Let the configs in a folder run at 10 Hz, which a busy machine keeps."""
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
"""The example, calm: at 1000 Hz a stack takes a core, of two, from the tests beside it."""


def parameters(**values: str) -> dict[str, Any]:
    """Keyword arguments of a node that has these parameters."""
    return {"parameter_overrides": [Parameter(name, value=value) for name, value in values.items()]}


@contextmanager
def spinning(
    make: Callable[[], N], make_executor: Callable[[], Executor] = SingleThreadedExecutor
) -> Iterator[N]:
    """A node that spins in a thread, in a context of its own."""
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
        # Shut down while it spins, an rclpy executor may stumble over what it has just let go.
        over.set_result(None)
        thread.join()
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
        # A life-cycle node is part of reference cycles, and in the ROS graph until they are gone;
        # an executor that spun keeps the nodes that it looked at last.
        del node, executor, spin, thread
        gc.collect()


def request(node: GuardedLifecycleNode, label: str = "", number: int = 0) -> bool:
    """Call the node's change_state as its service would: on the thread that spins it."""
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
    """A command, with limits that a busy machine keeps; a test of the limits gives its own."""
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
    """Run obk to its end, with these variables too, in a folder (None: the current one)."""
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
    """A stack that has got to a phase; ended by SIGINT at the latest."""
    with started(config, *options) as run:
        run.wait_for(phase)
        yield run


@contextmanager
def started(config: Path, *options: object) -> Iterator["Launched"]:
    """A stack that comes up; ended by SIGINT at the latest."""
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
    """A running `obk launch` and what it has said so far."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self.process = process
        self.lines: list[str] = []
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()
        self.descendants: set[psutil.Process] = set()

    @property
    def text(self) -> str:
        """All that was said."""
        return "\n".join(self.lines)

    @property
    def cause(self) -> str:
        """The line that reports why the run failed; empty when it did not."""
        return next((line for line in self.lines if line.startswith("failed: ")), "")

    def wait_for(self, phase: str) -> None:
        """Wait for a phase line, and note every process below the launcher."""
        eventually(
            lambda: any(f"s] {phase}" in line for line in self.lines) or self._has_ended(),
            f"the phase {phase}",
            seen=lambda: self.text,
        )
        assert not self._has_ended(), self.text
        self.descendants |= set(psutil.Process(self.process.pid).children(recursive=True))

    def wait_for_line(self, part: str, deadline_s: float = DEADLINE_S) -> None:
        """Wait for a line with these words."""

        def is_said() -> bool:
            return any(part in line for line in self.lines)

        def is_over() -> bool:
            return is_said() or not self.reader.is_alive()

        eventually(is_over, part, seen=lambda: self.text, deadline_s=deadline_s)
        assert is_said(), self.text

    def node(self, name: str) -> psutil.Process:
        """The process of a node."""
        argument = f"__node:={name}"
        return next(p for p in self.descendants if argument in p.cmdline())

    def left_over(self) -> list[psutil.Process]:
        """Processes of the stack that are still there, zombies not counted."""
        return [p for p in self.descendants if _is_there(p)]

    def _has_ended(self) -> bool:
        return self.process.poll() is not None

    def _read(self) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as output:
            for line in output:
                self.lines.append(line.rstrip("\n"))


def marked() -> list[psutil.Process]:
    """The processes, this one aside, that carry this test's mark in their environment."""
    return [p for p in psutil.process_iter() if p.pid != os.getpid() and _is_marked(p)]


def _is_marked(process: psutil.Process) -> bool:
    try:
        return process.environ().get(MARK) == os.environ[MARK]
    except psutil.Error:  # ended meanwhile, or another user's
        return False


def _is_there(process: psutil.Process) -> bool:
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
