"""Run one Obelisk node as a process: from ROS arguments to an exit code."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from types import FrameType
from typing import Any, Self

import rclpy
from rclpy.executors import Executor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.signals import SignalHandlerOptions

from obelisk_py.core.executors import EventLoopExecutor
from obelisk_py.core.faults import Fault
from obelisk_py.core.lifecycle import GuardedLifecycleNode

__all__ = ["spin_obelisk"]

END_SIGNALS = (signal.SIGINT, signal.SIGTERM)
NEARLY_FOR_EVER_S = 3e8
"""Ten years [s]: without a timeout rclpy's EventsExecutor overflows and runs no callback at all."""


def spin_obelisk(
    args: Sequence[str] | None,
    node_type: Callable[..., GuardedLifecycleNode],
    executor_type: Callable[..., Executor] | None = None,
    node_kwargs: Mapping[str, Any] | None = None,
) -> None:
    """Make a node and spin it until SIGINT, SIGTERM, or a fault that it cannot recover from.

    On a signal the node is deactivated, cleaned up and shut down; a second signal ends the process
    at once.

    Args:
        args: command line with `--ros-args ...`; None takes the process's own.
        node_type: the node class.
        executor_type: an rclpy executor class; None takes the library's `EventLoopExecutor`.
        node_kwargs: handed to the node class.

    Raises:
        SystemExit: with code 1, the node died of an error.
    """
    with _EndSignals() as signals:
        # rclpy's own handlers end the context before the node could be brought down in order.
        rclpy.init(
            args=None if args is None else list(args),
            signal_handler_options=SignalHandlerOptions.NO,
        )
        executor = (executor_type or EventLoopExecutor)()
        try:
            node = node_type(**(node_kwargs or {}))
            executor.add_node(node)
            signals.hand_to(lambda: executor.create_task(_bring_down, node))
            fault = _spin(executor, node)
            executor.remove_node(node)
            node.destroy_node()
        finally:
            executor.shutdown()
            rclpy.try_shutdown()
    if fault is not None:
        sys.exit(1)


def _spin(executor: Executor, node: GuardedLifecycleNode) -> Fault | None:
    """Spin until the node has ended; what it died of."""
    try:
        executor.spin_until_future_complete(node.ended, timeout_sec=NEARLY_FOR_EVER_S)
    except Exception:
        # Not a callback of the node's own, those are guarded; it still does not just vanish.
        _bring_down(node)
        raise
    fault: Fault | None = node.ended.result()
    return fault


def _bring_down(node: GuardedLifecycleNode) -> None:
    """Deactivate, clean up and shut down, or straight from where a step does not get further."""
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
            node.trigger_shutdown()
            break
    if not node.ended.done():
        node.ended.set_result(fault)


class _EndSignals:
    """While entered, the first end signal calls back from a thread, the second ends the process.

    The interpreter runs a signal handler only when the main thread is back in Python, which an
    executor that waits in C++ never is; the wake-up descriptor is written at once.
    Source: https://docs.python.org/3/library/signal.html#signal.set_wakeup_fd
    """

    def __init__(self) -> None:
        self._on_signal: Callable[[], object] | None = None
        self._seen = 0
        self._lock = threading.Lock()

    def __enter__(self) -> Self:
        self._read_fd, self._write_fd = os.pipe2(os.O_CLOEXEC | os.O_NONBLOCK)
        os.set_blocking(self._read_fd, True)
        self._old_fd = signal.set_wakeup_fd(self._write_fd, warn_on_full_buffer=False)
        self._old = {number: signal.signal(number, _left_to_the_thread) for number in END_SIGNALS}
        self._thread = threading.Thread(target=self._watch, name="end signals", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._old.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._old_fd)
        os.close(self._write_fd)
        self._thread.join()
        os.close(self._read_fd)

    def hand_to(self, on_signal: Callable[[], object]) -> None:
        """Call back from now on, and at once if a signal has come already."""
        with self._lock:
            self._on_signal = on_signal
            if self._seen:
                on_signal()

    def _watch(self) -> None:
        while number := os.read(self._read_fd, 1):
            if number[0] not in END_SIGNALS:
                continue
            with self._lock:
                self._seen += 1
                if self._seen > 1:
                    os._exit(128 + number[0])
                if self._on_signal is not None:
                    self._on_signal()


def _left_to_the_thread(_number: int, _frame: FrameType | None) -> None:
    """The wake-up descriptor has told the thread."""
