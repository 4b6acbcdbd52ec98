"""Spin nodes from the start of their process to a clean shutdown, and return the exit code.

Processes with one node and with several nodes share this module. `spin_obelisk` creates a
`SpinRequest`. The process serves it itself, or the host of a composed process does (see
`composition`). SIGINT and SIGTERM shut down cleanly; a second one terminates the process
immediately.
"""

import faulthandler
import fcntl
import os
import signal
import threading
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from types import FrameType
from typing import Any, Self

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.timer import Timer

from obelisk_py.core.clock_page import ClockPage, open_clock_page
from obelisk_py.core.exceptions import ObeliskError
from obelisk_py.core.executor import EventLoopExecutor
from obelisk_py.core.faults import NodeFault, fault_of
from obelisk_py.core.lifecycle import GuardedLifecycleNode
from obelisk_py.core.shared_clock import new_nodes_follow
from obelisk_py.core.time_slice import shorten_time_slice
from obelisk_spec.runtime_protocol import GATE_VARIABLE

__all__ = [
    "NodeDied",
    "ShutdownSignals",
    "SpinRequest",
    "ros_process",
    "serve_spin_request",
    "simulated_time_from",
    "spin_nodes",
    "spin_requests_served_by",
    "wait_at_gate",
]

SHUTDOWN_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_STOP = b"\0"
"""In the pipe of signal numbers: no more signals follow."""


class ShutdownSignals:
    """Calls back from a thread at the first signal; the second one terminates the process.

    Signals to a forked child, such as one of `multiprocessing`, affect only the child.
    """

    def __init__(self) -> None:
        self._on_signal: Callable[[], object] | None = None
        self._seen = 0
        self._lock = threading.Lock()

    def __enter__(self) -> Self:
        self._read_fd, self._write_fd = os.pipe2(os.O_CLOEXEC | os.O_NONBLOCK)
        os.set_blocking(self._read_fd, True)
        self._old_fd = signal.set_wakeup_fd(self._write_fd, warn_on_full_buffer=False)
        self._old = {number: signal.signal(number, _ignore) for number in SHUTDOWN_SIGNALS}
        self._thread = threading.Thread(target=self._watch, name="end signals", daemon=True)
        self._thread.start()
        self._is_active = True
        os.register_at_fork(after_in_child=_in_child(weakref.ref(self)))
        return self

    def __exit__(self, *_: object) -> None:
        self._restore(self._old_fd)
        # Not by closing this end: children may have copies of it.
        os.write(self._write_fd, _STOP)
        self._thread.join()
        self._close()

    def leave_in_child(self) -> None:
        """Give up the signals in a forked process; it has copies of the descriptors."""
        if self._is_active:
            self._restore(-1)
            self._close()

    def _restore(self, wakeup_fd: int) -> None:
        self._is_active = False
        for number, handler in self._old.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(wakeup_fd)

    def _close(self) -> None:
        os.close(self._write_fd)
        os.close(self._read_fd)

    def call_back(self, on_signal: Callable[[], object]) -> None:
        """Set the function to call at the first signal; call it now if one already arrived."""
        with self._lock:
            self._on_signal = on_signal
            if self._seen:
                on_signal()

    def _watch(self) -> None:
        while (number := os.read(self._read_fd, 1)) != _STOP:
            if number[0] not in SHUTDOWN_SIGNALS:
                continue
            with self._lock:
                self._seen += 1
                if self._seen > 1:
                    os._exit(128 + number[0])
                if self._on_signal is not None:
                    self._on_signal()


def _in_child(signals: "weakref.ref[ShutdownSignals]") -> Callable[[], None]:
    """The function to call after a fork; it cannot be unregistered, so it keeps nothing alive."""

    def leave() -> None:
        active = signals()
        if active is not None:
            active.leave_in_child()

    return leave


def _ignore(_number: int, _frame: FrameType | None) -> None:
    """Do nothing; the wake-up descriptor notifies the thread."""


LONGEST_SPIN_S = 3e8
"""Ten years [s]: without a timeout, rclpy's EventsExecutor overflows and runs no callbacks. The
library's own executor spins without one, because a timeout takes time in every round."""
NODE_LOGGER = "obelisk"
"""The logger of a process whose node could not be created."""
STDERR_FD = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class SpinRequest:
    """The arguments of `spin_obelisk`."""

    args: tuple[str, ...]
    """The command line, including `--ros-args ...`."""
    make: Callable[[], GuardedLifecycleNode]
    executor_type: Callable[..., Executor] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeDied:
    """A node that cannot continue, and its fault."""

    node: GuardedLifecycleNode
    fault: NodeFault


def serve_spin_request(request: SpinRequest) -> int:
    """Spin a node until it shuts down, and return the exit code of its process."""
    return _spinner.get()(request)


@contextmanager
def spin_requests_served_by(spinner: Callable[[SpinRequest], int]) -> Iterator[None]:
    """Make this host serve the requests of `spin_obelisk` inside the `with` block."""
    token = _spinner.set(spinner)
    try:
        yield
    finally:
        _spinner.reset(token)


@contextmanager
def ros_process(args: Sequence[str]) -> Iterator[ShutdownSignals]:
    """Set up a process that runs nodes: its ROS context, signals and stack dumps.

    On SIGUSR1 and on a crash, the stack of every thread is written to stderr.
    """
    faulthandler.enable(STDERR_FD)
    faulthandler.register(signal.SIGUSR1, STDERR_FD)
    with ShutdownSignals() as signals:
        if not rclpy.ok():  # a program may have initialized ROS itself
            # rclpy's own handlers end the context before the nodes can be shut down.
            rclpy.init(args=list(args), signal_handler_options=SignalHandlerOptions.NO)
        try:
            yield signals
        finally:
            rclpy.try_shutdown()


def spin_nodes(
    executor: Executor, nodes: Sequence[GuardedLifecycleNode], signals: ShutdownSignals
) -> NodeDied | None:
    """Spin until all nodes have shut down, in short time slices.

    A signal, or a node that cannot continue, shuts down all of them in reverse order.

    Raises:
        BaseException: raised by a callback that belongs to no node; the nodes are shut down.

    Returns:
        The first node that cannot continue, if any.
    """
    died: list[NodeDied] = []
    over = _End()

    def shut_down() -> None:
        executor.create_task(_shut_down_all, nodes)

    def note(node: GuardedLifecycleNode) -> None:
        fault = node.ended.result()
        if fault is not None:
            died.append(NodeDied(node=node, fault=fault))
            shut_down()
        if all(other.ended.done() for other in nodes) and not over.done():
            over.set_result(None)

    for node in nodes:
        executor.add_node(node)
        node.ended.add_done_callback(lambda _, node=node: note(node))
    signals.call_back(shut_down)
    # Not before the nodes are created: the middleware's threads would inherit short slices, and
    # preempt each other all the time while many processes discover each other.
    shorten_time_slice()
    timeout_s = None if isinstance(executor, EventLoopExecutor) else LONGEST_SPIN_S
    try:
        executor.spin_until_future_complete(over, timeout_sec=timeout_s)
    except BaseException:
        # Callbacks of nodes are guarded, so this is from another callback; shut the nodes down too.
        _shut_down_all(nodes)
        raise
    for node in nodes:
        executor.remove_node(node)
        node.destroy_node()
    return died[0] if died else None


class _End(Future):
    """A future that keeps one callback: the one that wakes the executor spinning for the future.

    rclpy's executors add another callback each time that they run one, and remove none.
    """

    def add_done_callback(self, callback: Callable[[Future], None]) -> None:
        """Add a callback; only the first one is kept."""
        if self.done() or not self._callbacks:
            super().add_done_callback(callback)


class _ThreadPool(MultiThreadedExecutor):
    """rclpy's multi-threaded executor, safe for timers that are canceled or destroyed when due.

    A transition cancels timers on one thread while others run callbacks. In ROS 2 Jazzy, the
    executor then raises an exception, or the timer's callback group stays blocked and the node
    responds to no more requests.
    """

    def wait_for_ready_callbacks(self, *args: Any, **kwargs: Any) -> Any:
        """Wait like rclpy's; try again if an entity was destroyed in the meantime."""
        while True:
            try:
                return super().wait_for_ready_callbacks(*args, **kwargs)
            except InvalidHandle:
                continue

    def _take_timer(self, tmr: Timer) -> Any:
        try:
            return super()._take_timer(tmr)
        except RCLError:
            try:
                is_cancelled = tmr.is_canceled()
            except InvalidHandle:
                return None
            if not is_cancelled:
                raise
            return None


EXECUTOR_VARIABLE = "OBK_EXECUTOR"
"""If set to `rclpy`, programs that name an rclpy executor use that one."""
PARALLEL_GROUPS = 16
"""`num_threads` of the executor that replaces rclpy's pool. Callback groups of a node should not
share a thread: a callback may wait for a service whose client is in another group. Idle threads
cost nothing."""


def _make_executor(kind: Callable[..., Executor] | None) -> Executor:
    """Create the executor for a program that names one of rclpy's, or None.

    rclpy's wait sets cannot keep up with a loop at 1 kHz. The library's executor gives the same
    guarantees as the two that existing code names: one callback at a time, or parallel callback
    groups.
    """
    if os.environ.get(EXECUTOR_VARIABLE) == "rclpy":
        return _ThreadPool() if kind is MultiThreadedExecutor else (kind or EventLoopExecutor)()
    if kind is MultiThreadedExecutor:
        return EventLoopExecutor(num_threads=PARALLEL_GROUPS)
    return EventLoopExecutor() if kind is SingleThreadedExecutor else (kind or EventLoopExecutor)()


@contextmanager
def simulated_time_from(page: ClockPage | None, executor: Executor) -> Iterator[None]:
    """Inside the `with` block, new nodes take simulated time from a page, if the executor can.

    Only the library's executor wakes timers by the page; with another one, nodes use `/clock`.
    """
    if page is None or not isinstance(executor, EventLoopExecutor):
        yield
        return
    executor.follow(page)
    with new_nodes_follow(page):
        yield


def wait_at_gate() -> None:
    """If the launcher started this process early, wait until it permits creating nodes."""
    path = os.environ.get(GATE_VARIABLE)
    if path is None:
        return
    try:
        gate = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:  # a late restart: the run folder has been removed
        return
    try:
        fcntl.flock(gate, fcntl.LOCK_SH)
    finally:
        os.close(gate)


def _spin_alone(request: SpinRequest) -> int:
    # Before signal handlers are installed, so that a signal terminates a waiting process.
    wait_at_gate()
    with ros_process(request.args) as signals, open_clock_page() as page:
        executor = _make_executor(request.executor_type)
        try:
            with simulated_time_from(page, executor):
                node = request.make()
        except ObeliskError as error:
            executor.shutdown()
            # The message names the mistake; a traceback of the library would hide it.
            get_logger(NODE_LOGGER).error(f"the node cannot be created: {error}")
            return 1
        try:
            died = spin_nodes(executor, [node], signals)
        except SystemExit as end:
            # Python itself would exit without a word.
            node.get_logger().error(str(fault_of(end, "a callback")))
            raise
        finally:
            executor.shutdown()
    return int(died is not None)


def _shut_down_all(nodes: Sequence[GuardedLifecycleNode]) -> None:
    for node in reversed(nodes):
        if not node.ended.done():
            _shut_down(node)


def _shut_down(node: GuardedLifecycleNode) -> None:
    """Deactivate, clean up and shut down; if a transition fails, shut down from there."""
    steps = {
        "active": node.trigger_deactivate,
        "inactive": node.trigger_cleanup,
        "unconfigured": node.trigger_shutdown,
    }
    fault = None
    while (state := node.state_label) in steps:
        if steps[state]() != TransitionCallbackReturn.SUCCESS:
            fault = node.last_fault
        if node.state_label == state:
            if state != "unconfigured":
                node.trigger_shutdown()
            break
    if not node.ended.done():
        node.ended.set_result(fault)


_spinner: ContextVar[Callable[[SpinRequest], int]] = ContextVar("spinner", default=_spin_alone)
