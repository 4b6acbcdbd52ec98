"""What rcl has no listener for: guard conditions, actions and other waitables.

One thread waits for them in a small wait set and posts what is ready to the lanes of their
callback groups. It costs nothing while nothing happens, and it is how an executor learns that a
signal ended the context. It never calls the user.
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

from obelisk_py.core.executors.entities import ExecutorReference
from obelisk_py.core.executors.lane import Job, Lane

__all__ = ["AuxiliaryRunner", "AuxiliaryThread", "GuardRunner", "WaitableRunner"]

_END_AFTER_SIGNAL_S = 2.0
_LOOK_EVERY_S = 0.002


class AuxiliaryRunner(ABC):
    """An entity that the thread waits for, and what a lane does when it is ready."""

    def __init__(
        self,
        entity: Any,
        post: Callable[[Job], None],
        executor: ExecutorReference,
        rewatch: Callable[[], None],
    ) -> None:
        """Prepare.

        Args:
            entity: of rclpy.
            post: hands a job to the lane, or lanes, of the entity's callback group.
            executor: for futures and coroutines that the entity's callbacks make.
            rewatch: lets the thread look again at what to wait for.
        """
        self.entity = entity
        self.is_waited_for = True
        self.is_gone = False
        """The node has it no longer."""
        self._post = post
        self._executor = executor
        self._rewatch = rewatch

    def post(self) -> None:
        """Let a lane do what is to be done."""
        self._post(self._run_unless_gone)

    def _run_unless_gone(self, lane: Lane) -> bool:
        return not self.is_gone and self._run(lane)

    @abstractmethod
    def _run(self, lane: Lane) -> bool: ...

    def _begin(self, lane: Lane, callback: Callable[..., Any], *args: Any) -> None:
        task = Task(callback, args, None, executor=self._executor())
        lane.begin(task, self.entity.callback_group)


class GuardRunner(AuxiliaryRunner):
    """Calls the user when a guard condition was triggered."""

    entity: GuardCondition

    def _run(self, lane: Lane) -> bool:
        self._begin(lane, self.entity.callback)
        return True


class WaitableRunner(AuxiliaryRunner):
    """Lets a waitable take what it has and execute; until it has taken it, it stays ready."""

    entity: Waitable

    def post(self) -> None:
        """Let a lane take the data and execute."""
        self.is_waited_for = False
        super().post()

    def _run(self, lane: Lane) -> bool:
        for future in self.entity._futures:
            future._set_executor(self._executor())
        try:
            data = self.entity.take_data()
        except InvalidHandle:  # destroyed since it was ready
            return False
        finally:
            self.is_waited_for = True
            self._rewatch()
        self._begin(lane, self.entity.execute, data)
        return True


class AuxiliaryThread:
    """Waits for guard conditions and waitables."""

    def __init__(self, context: Context, on_event: Callable[[BaseException | None], None]) -> None:
        """Prepare; the thread begins with `start`.

        Args:
            context: whose end is watched.
            on_event: called by the thread when the context has ended, or with the fault that
                ended the thread.
        """
        self._context = context
        self._on_event = on_event
        self._runners: Sequence[AuxiliaryRunner] = ()
        self._is_stopped = False
        self._thread: threading.Thread | None = None
        self._change = GuardCondition(None, None, context=context)
        self._signal = SignalHandlerGuardCondition(context)
        context.on_shutdown(self.wake)

    def start(self) -> None:
        """Begin to wait, if it did not begin before."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._main, name="auxiliary", daemon=True)
            self._thread.start()

    def watch(self, runners: Sequence[AuxiliaryRunner]) -> None:
        """Wait for these from now on."""
        self._runners = runners
        self.wake()

    def wake(self) -> None:
        """Look again at what to wait for."""
        with suppress(InvalidHandle):  # stopped meanwhile
            self._change.trigger()

    def stop(self, timeout_s: float | None) -> bool:
        """End the thread; false if it has not ended after `timeout_s` [s]."""
        self._is_stopped = True
        self.wake()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(timeout_s)
            if self._thread.is_alive():
                return False
        # `_signal` is left to the garbage collector: after a signal, a thread of rclpy may be about
        # to trigger it, and would crash.
        self._change.destroy()
        return True

    def _main(self) -> None:
        fault: BaseException | None = None
        try:
            while self._context.ok() and not self._is_stopped:
                self._post_ready()
        except Exception as error:
            # A context that ends takes the wait set with it.
            fault = error if self._context.ok() and not self._is_stopped else None
        if not self._is_stopped:
            self._on_event(fault)

    def _post_ready(self) -> None:
        with ExitStack() as held:
            assert self._context.handle is not None  # it was initialised
            held.enter_context(self._context.handle)
            own = [self._change, self._signal]
            for guard in own:
                held.enter_context(guard.handle)
            waiting = [runner for runner in self._runners if runner.is_waited_for]
            guards = [
                runner
                for runner in waiting
                if isinstance(runner, GuardRunner) and _entered(held, runner.entity.handle)
            ]
            waitables = [
                runner
                for runner in waiting
                if isinstance(runner, WaitableRunner) and _entered(held, runner.entity)
            ]
            wait_set = self._wait_set([*own, *(runner.entity for runner in guards)], waitables)
            wait_set.wait(-1)
            triggered = set(wait_set.get_ready_entities("guard_condition"))
            ready: list[AuxiliaryRunner] = [
                *(runner for runner in guards if runner.entity.handle.pointer in triggered),
                *(runner for runner in waitables if runner.entity.is_ready(wait_set)),
            ]
        for runner in ready:
            runner.post()
        if self._signal.handle.pointer in triggered:
            self._await_end_of_context()

    def _await_end_of_context(self) -> None:
        """Be patient: the signal handler triggers first and ends the context a little later."""
        end_s = time.monotonic() + _END_AFTER_SIGNAL_S
        while self._context.ok() and not self._is_stopped and time.monotonic() < end_s:
            time.sleep(_LOOK_EVERY_S)

    def _wait_set(
        self, guards: Sequence[GuardCondition], waitables: Sequence[WaitableRunner]
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
    """Keep it from being destroyed while `held` is; false if it is destroyed already."""
    try:
        held.enter_context(destroyable)
    except InvalidHandle:
        return False
    return True
