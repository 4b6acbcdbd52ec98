"""Run one Obelisk node as a process: from ROS arguments to an exit code."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from types import FrameType
from typing import Any

import rclpy
from rclpy.executors import Executor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from obelisk_py.core.executors import EventLoopExecutor
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
    # rclpy's own handlers end the context before the node could be brought down in order.
    rclpy.init(
        args=None if args is None else list(args), signal_handler_options=SignalHandlerOptions.NO
    )
    executor = (executor_type or EventLoopExecutor)()
    try:
        node = node_type(**(node_kwargs or {}))
        executor.add_node(node)
        with _EndSignals(lambda: executor.create_task(_bring_down, node)):
            executor.spin_until_future_complete(node.ended, timeout_sec=NEARLY_FOR_EVER_S)
        fault = node.ended.result()
        executor.remove_node(node)
        node.destroy_node()
    finally:
        executor.shutdown()
        rclpy.try_shutdown()
    if fault is not None:
        sys.exit(1)


def _bring_down(node: GuardedLifecycleNode) -> None:
    steps = {
        "active": (node.trigger_deactivate, node.trigger_cleanup, node.trigger_shutdown),
        "inactive": (node.trigger_cleanup, node.trigger_shutdown),
        "unconfigured": (node.trigger_shutdown,),
    }
    for step in steps.get(node.state_label, ()):
        step()
        if node.state_label == "finalized":
            break
    _end(node.ended)


def _end(ended: Future) -> None:
    if not ended.done():
        ended.set_result(None)


class _EndSignals:
    """While entered, the first end signal calls back from a thread, the second ends the process.

    The interpreter runs a signal handler only when the main thread is back in Python, which an
    executor that waits in C++ never is; the wake-up descriptor is written at once.
    Source: https://docs.python.org/3/library/signal.html#signal.set_wakeup_fd
    """

    def __init__(self, on_signal: Callable[[], object]) -> None:
        self._on_signal = on_signal

    def __enter__(self) -> None:
        self._read_fd, self._write_fd = os.pipe2(os.O_CLOEXEC | os.O_NONBLOCK)
        os.set_blocking(self._read_fd, True)
        self._old_fd = signal.set_wakeup_fd(self._write_fd, warn_on_full_buffer=False)
        self._old = {number: signal.signal(number, _left_to_the_thread) for number in END_SIGNALS}
        self._thread = threading.Thread(target=self._watch, name="end signals", daemon=True)
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        for number, handler in self._old.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._old_fd)
        os.close(self._write_fd)
        self._thread.join()
        os.close(self._read_fd)

    def _watch(self) -> None:
        seen = 0
        while number := os.read(self._read_fd, 1):
            if number[0] not in END_SIGNALS:
                continue
            seen += 1
            if seen > 1:
                os._exit(128 + number[0])
            self._on_signal()


def _left_to_the_thread(_number: int, _frame: FrameType | None) -> None:
    """The wake-up descriptor has told the thread."""
