"""Run tasks and coroutines as events: the executor of nodes in lockstep.

rclpy's executors poll a waiting coroutine until its future is done. Here, the coroutine continues
in the event that completes the future.
"""

import functools
import inspect
import types
from typing import Any

from rclpy.executors import Executor
from rclpy.task import Future, Task

from obelisk_py.core.lockstep.scheduler import MESSAGE, ScheduledNode, Scheduler

__all__ = ["LockstepExecutor"]


class LockstepExecutor(Executor):
    """The executor methods that rclpy and the library use, without spinning."""

    def __init__(self, scheduler: Scheduler) -> None:
        """Run tasks as events of a scheduler."""
        super().__init__()
        self._scheduler = scheduler

    def wake(self) -> None:
        """Do nothing, because nothing waits."""

    def create_task(self, callback: Any, *args: Any, **kwargs: Any) -> Task:
        """Run a function or coroutine in an event of the running node."""
        task = Task(callback, args, kwargs, executor=self)
        if inspect.iscoroutine(callback):
            task._handler = callback
        self._push(task, self._scheduler.running)
        return task

    def run_coroutine(self, coroutine: Any, node: ScheduledNode) -> None:
        """Run a coroutine returned by a node's callback, now and up to its first wait."""
        task = Task(None, executor=self)
        task._handler = coroutine
        self._run(task, node)

    def _push(self, task: Task, node: ScheduledNode | None) -> None:
        call = functools.partial(self._run, task, node)
        self._scheduler.push(self._scheduler.time_ns, MESSAGE, node, call)

    def _run(self, task: Task, node: ScheduledNode | None) -> None:
        coroutine = task._handler
        task()
        if task.done() or task.cancelled():
            # The callbacks of the library's nodes are guarded; tasks created by user code are not.
            if (error := task.exception()) is not None:
                if node is None:
                    raise error
                node.node.fail(error, "a task of the executor")
            return
        future = _awaited_future(coroutine)
        resume = functools.partial(self._push, task, node)
        if future is None:
            # The coroutine awaits a custom awaitable, so check again 1 ms later.
            due_ns = self._scheduler.time_ns + 1_000_000
            self._scheduler.push(due_ns, MESSAGE, node, functools.partial(self._run, task, node))
        else:
            future.add_done_callback(lambda _future: resume())


def _awaited_future(coroutine: Any) -> Future | None:
    """The future that a suspended coroutine waits for, at the end of its chain of awaits."""
    inner = coroutine
    while inner is not None:
        if isinstance(inner, types.GeneratorType):
            if inner.gi_yieldfrom is None:
                frame = inner.gi_frame
                awaited = frame.f_locals.get("self") if frame is not None else None
                return awaited if isinstance(awaited, Future) else None
            inner = inner.gi_yieldfrom
        else:
            inner = getattr(inner, "cr_await", None)
    return None
