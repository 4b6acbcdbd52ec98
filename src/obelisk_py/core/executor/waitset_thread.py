"""Wait for guard conditions, actions and other waitables in a separate thread.

rcl has no listeners for these. One thread waits for them in a small wait set and posts ready
entities to the workers of their callback groups. It uses no CPU time while idle. It detects when a
signal shuts down the context. It never runs user code.
"""

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from typing import Any

from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerGuardCondition
from rclpy.task import Task
from rclpy.waitable import NumberOfEntities, Waitable

from obelisk_py.core.executor.handlers import ExecutorReference
from obelisk_py.core.executor.worker import Job, Worker

__all__ = ["GuardConditionHandler", "WaitSetHandler", "WaitSetThread", "WaitableHandler"]

_END_AFTER_SIGNAL_S = 2.0
_POLL_PERIOD_S = 0.002


class WaitSetHandler(ABC):
    """An entity that the thread waits for, and the work that a worker does when it is ready."""

    def __init__(
        self,
        entity: Any,
        post: Callable[[Job], None],
        executor: ExecutorReference,
        update_wait: Callable[[], None],
    ) -> None:
        """Create the handler.

        Args:
            entity: an rclpy entity.
            post: queues a job for the workers of the entity's callback group.
            executor: runs futures and coroutines of the entity's callbacks.
            update_wait: makes the thread update the entities that it waits for.
        """
        self.entity = entity
        self.is_waited_for = True
        self.is_destroyed = False
        """Whether the node has destroyed it."""
        self._post = post
        self._executor = executor
        self._update_wait = update_wait

    def post(self) -> None:
        """Queue the entity for a worker."""
        self._post(self._run_unless_destroyed)

    def _run_unless_destroyed(self, worker: Worker) -> bool:
        return not self.is_destroyed and self._run(worker)

    @abstractmethod
    def _run(self, worker: Worker) -> bool: ...

    def _run_task(self, worker: Worker, callback: Callable[..., Any], *args: Any) -> None:
        task = Task(callback, args, None, executor=self._executor())
        worker.run_task(task, self.entity.callback_group)


class GuardConditionHandler(WaitSetHandler):
    """Runs the callback of a triggered guard condition."""

    entity: GuardCondition

    def _run(self, worker: Worker) -> bool:
        self._run_task(worker, self.entity.callback)
        return True


class WaitableHandler(WaitSetHandler):
    """Makes a waitable take its data and execute; it stays ready until the data is taken."""

    entity: Waitable

    def post(self) -> None:
        """Queue the waitable, and stop waiting for it until its data is taken."""
        self.is_waited_for = False
        super().post()

    def _run(self, worker: Worker) -> bool:
        for future in self.entity._futures:
            future._set_executor(self._executor())
        try:
            data = self.entity.take_data()
        except InvalidHandle:  # destroyed since it was ready
            return False
        finally:
            self.is_waited_for = True
            self._update_wait()
        self._run_task(worker, self.entity.execute, data)
        return True


class WaitSetThread:
    """Waits for guard conditions and waitables."""

    def __init__(self, context: Context, on_event: Callable[[BaseException | None], None]) -> None:
        """Create the thread without starting it.

        Args:
            context: its shutdown is reported.
            on_event: called by the thread with None when the context was shut down, or with the
                exception that ended the thread.
        """
        self._context = context
        self._on_event = on_event
        self._handlers: Sequence[WaitSetHandler] = ()
        self._is_stopped = False
        self._thread: threading.Thread | None = None
        self._change = GuardCondition(None, None, context=context)
        self._signal = SignalHandlerGuardCondition(context)
        context.on_shutdown(self.wake)

    def start(self) -> None:
        """Start the thread, unless it is running."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._main, name="wait set", daemon=True)
            self._thread.start()

    def watch(self, handlers: Sequence[WaitSetHandler]) -> None:
        """Replace the entities to wait for."""
        self._handlers = handlers
        self.wake()

    def wake(self) -> None:
        """Make the thread update the entities that it waits for."""
        with suppress(InvalidHandle):  # already stopped
            self._change.trigger()

    def stop(self, timeout_s: float | None) -> bool:
        """Stop the thread; false if it is still running after `timeout_s` [s]."""
        self._is_stopped = True
        self.wake()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(timeout_s)
            if self._thread.is_alive():
                return False
        # `_signal` is left to the garbage collector: after a signal, an rclpy thread may be about
        # to trigger it and would crash.
        self._change.destroy()
        return True

    def _main(self) -> None:
        fault: BaseException | None = None
        try:
            while self._context.ok() and not self._is_stopped:
                self._post_ready()
        except Exception as error:
            # A context that is shut down invalidates the wait set.
            fault = error if self._context.ok() and not self._is_stopped else None
        if not self._is_stopped:
            self._on_event(fault)

    def _post_ready(self) -> None:
        with ExitStack() as held:
            assert self._context.handle is not None  # the context is initialized
            held.enter_context(self._context.handle)
            own = [self._change, self._signal]
            for guard in own:
                held.enter_context(guard.handle)
            waiting = [handler for handler in self._handlers if handler.is_waited_for]
            guards = [
                handler
                for handler in waiting
                if isinstance(handler, GuardConditionHandler)
                and _entered(held, handler.entity.handle)
            ]
            waitables = [
                handler
                for handler in waiting
                if isinstance(handler, WaitableHandler) and _entered(held, handler.entity)
            ]
            wait_set = self._wait_set([*own, *(handler.entity for handler in guards)], waitables)
            wait_set.wait(-1)
            triggered = set(wait_set.get_ready_entities("guard_condition"))
            ready: list[WaitSetHandler] = [
                *(handler for handler in guards if handler.entity.handle.pointer in triggered),
                *(handler for handler in waitables if handler.entity.is_ready(wait_set)),
            ]
        for handler in ready:
            handler.post()
        if self._signal.handle.pointer in triggered:
            self._await_end_of_context()

    def _await_end_of_context(self) -> None:
        """Wait for the signal handler, which triggers before it shuts down the context."""
        end_s = time.monotonic() + _END_AFTER_SIGNAL_S
        while self._context.ok() and not self._is_stopped and time.monotonic() < end_s:
            time.sleep(_POLL_PERIOD_S)

    def _wait_set(
        self, guards: Sequence[GuardCondition], waitables: Sequence[WaitableHandler]
    ) -> Any:
        size = sum((w.entity.get_num_entities() for w in waitables), NumberOfEntities())
        wait_set = rclpy_implementation.WaitSet(
            size.num_subscriptions,
            size.num_guard_conditions + len(guards),
            size.num_timers,
            size.num_clients,
            size.num_services,
            size.num_events,
            self._context.handle,
        )
        wait_set.clear_entities()
        for guard in guards:
            wait_set.add_guard_condition(guard.handle)
        for waitable in waitables:
            waitable.entity.add_to_wait_set(wait_set)
        return wait_set


def _entered(held: ExitStack, destroyable: Any) -> bool:
    """Keep an entity alive while `held` is open; false if it is already destroyed."""
    try:
        held.enter_context(destroyable)
    except InvalidHandle:
        return False
    return True
