"""`EventLoopExecutor`: runs the callbacks of nodes, driven by events instead of by wait sets.

Nodes go in; their callbacks are called on the thread that spins, and with `num_threads` above 1 on
further ones. A callback's exception comes out of the spin function. With one thread it does what
rclpy's `SingleThreadedExecutor` does, at a fraction of the cost per callback; the callbacks of a
custom callback group are treated as mutually exclusive.
"""

import time
import weakref
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from rclpy.context import Context
from rclpy.executors import Executor, ExternalShutdownException, TimeoutObject
from rclpy.node import Node
from rclpy.task import Future, Task
from rclpy.utilities import get_default_context

from obelisk_py.core.executors.engine import Engine
from obelisk_py.core.executors.lane import Lane

__all__ = ["EventLoopExecutor"]

# What epoll takes is bounded; a wait that is cut short is only begun again.
_LONGEST_WAIT_S = 3600.0
_END_OF_PROCESS_S = 2.0


class EventLoopExecutor(Executor):
    """An rclpy executor for loops at high rates."""

    def __init__(self, num_threads: int = 1, *, context: Context | None = None) -> None:
        """Make an executor without nodes.

        Args:
            num_threads: at least 1; a mutually exclusive callback group keeps to one of them, a
                reentrant one runs on all.
            context: None takes the default one.

        Raises:
            ValueError: `num_threads` below 1.
        """
        context = get_default_context() if context is None else context
        # Before the base, whose constructor may call `wake`.
        self._engine = Engine(num_threads, context, weakref.ref(self))
        super().__init__(context=context)
        if num_threads < 1:
            raise ValueError(f"num_threads is {num_threads}, expected at least 1")
        # Also at the end of the process, for a program that shuts nothing down.
        self._finalizer = weakref.finalize(self, self._engine.stop, _END_OF_PROCESS_S)

    def wake(self) -> None:
        """Look at once at what changed: entities of a node, or the future that is waited for."""
        self._engine.call(entities_changed=True)

    def add_node(self, node: Node) -> bool:
        """Run a node's callbacks from now on; false if that is so already."""
        added = bool(super().add_node(node))
        self.wake()
        return added

    def remove_node(self, node: Node) -> None:
        """Run a node's callbacks no longer."""
        super().remove_node(node)
        self.wake()
        self._engine.settle()

    def create_task(
        self, callback: Callable[..., Any] | Coroutine[Any, Any, Any], *args: Any, **kwargs: Any
    ) -> Task:
        """Let a function or coroutine run while this executor spins; from any thread.

        Returns:
            A future of its result.
        """
        task = Task(callback, args, kwargs, executor=self)
        self._engine.jobs.put(partial(_begin, task))
        return task

    def spin(self) -> None:
        """Run callbacks until `shutdown`, or until the context ends."""
        with self._spinning() as lane:
            self._run(lane, None, None)

    def spin_until_future_complete(self, future: Future, timeout_sec: float | None = None) -> None:
        """Run callbacks until a future is done or cancelled.

        Args:
            future: what is waited for.
            timeout_sec: no longer than this [s]; without end if None or below 0.
        """
        with self._spinning() as lane, self._woken_by(future):
            self._run(lane, future, _end_s(timeout_sec))

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait for one callback and run it.

        Args:
            timeout_sec: wait no longer than this [s]; without end if None or below 0.

        Raises:
            ExternalShutdownException: the context has ended.
        """
        with self._spinning() as lane:
            self._run_once(lane, None, _end_s(timeout_sec))

    def spin_once_until_future_complete(
        self, future: Future, timeout_sec: float | TimeoutObject | None = None
    ) -> None:
        """As `spin_once`, but wait no longer than until the future is done.

        Raises:
            ExternalShutdownException: the context has ended.
        """
        timeout_s = timeout_sec.timeout if isinstance(timeout_sec, TimeoutObject) else timeout_sec
        with self._spinning() as lane, self._woken_by(future):
            self._run_once(lane, future, _end_s(timeout_s))

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """End all spinning and let go of all nodes.

        From within a callback it comes back at once, and the end comes after the callback.

        Args:
            timeout_sec: wait no longer than this for callbacks that run [s]; without end if None
                or below 0.

        Returns:
            Whether nothing runs any more.
        """
        timeout_s = None if timeout_sec is None or timeout_sec < 0 else timeout_sec
        self._is_shutdown = True
        ended = self._engine.stop(timeout_s)
        if ended:
            # Not the base's, which destroys a guard condition that a thread of rclpy may be about
            # to trigger after a signal; that crashes.
            with self._nodes_lock:
                self._nodes = set()
        return ended

    def _run(self, lane: Lane, future: Future | None, end_s: float | None) -> None:
        wait_s = -1.0
        while True:
            if lane.attention:
                lane.attention = False
                if not self._goes_on():
                    return
                self._engine.attend(lane)
            if future is not None and _is_over(future):
                return
            if end_s is not None:
                wait_s = _wait_s(end_s)
                if wait_s == 0:
                    return
            lane.run_ready(wait_s)

    def _run_once(self, lane: Lane, future: Future | None, end_s: float | None) -> None:
        ran = False
        while not ran:
            if lane.attention:
                lane.attention = False
                if not self._goes_on():
                    if not self._context.ok():
                        raise ExternalShutdownException
                    return
                ran = self._engine.attend(lane)
            wait_s = -1.0 if end_s is None else _wait_s(end_s)
            ran = ran or (future is not None and _is_over(future)) or lane.run_one(wait_s)
            if wait_s == 0:
                return

    def _goes_on(self) -> bool:
        engine = self._engine
        if engine.fault is not None:
            fault, engine.fault = engine.fault, None
            raise fault
        return not engine.is_stopped and bool(self._context.ok())

    @contextmanager
    def _spinning(self) -> Iterator[Lane]:
        engine = self._engine
        if not engine.spinning.acquire(blocking=False):
            raise RuntimeError("this executor is spinning already")
        try:
            engine.start()
            yield engine.lane
        finally:
            engine.pause()
            if engine.is_stopped:
                engine.close()
            engine.spinning.release()

    @contextmanager
    def _woken_by(self, future: Future) -> Iterator[None]:
        def wake(_future: Future) -> None:
            self._engine.call(entities_changed=False)

        if not _is_over(future):
            future.add_done_callback(wake)
        try:
            yield
        finally:
            future.remove_done_callback(wake)


def _begin(task: Task, lane: Lane) -> bool:
    lane.begin(task, None)
    return True


def _is_over(future: Future) -> bool:
    return bool(future.done() or future.cancelled())


def _end_s(timeout_s: float | None) -> float | None:
    """When a wait is over, on the monotonic clock [s]; None for never."""
    return None if timeout_s is None or timeout_s < 0 else time.monotonic() + timeout_s


def _wait_s(end_s: float) -> float:
    return min(max(0.0, end_s - time.monotonic()), _LONGEST_WAIT_S)
