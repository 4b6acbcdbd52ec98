"""`EventLoopExecutor`: run nodes' callbacks in response to events, without wait sets.

Callbacks run on the thread that spins, and on further threads if `num_threads` is above 1. The spin
function re-raises an exception from a callback. With one thread, the executor behaves like rclpy's
`SingleThreadedExecutor`, at a fraction of the cost per callback. It treats a custom callback group
as mutually exclusive.

A `_WorkerPool` starts, pauses and stops the threads together. A `_HandlerRegistry` maps entities to
their handlers and handlers to workers.
"""

import threading
import time
import weakref
from collections.abc import Callable, Coroutine, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, Self

from rclpy.callback_groups import CallbackGroup, ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor, ExternalShutdownException, TimeoutObject
from rclpy.node import Node
from rclpy.task import Future, Task
from rclpy.utilities import get_default_context

from obelisk_py.core.clock_page import ClockPage
from obelisk_py.core.executor.handlers import (
    ClientHandler,
    EntityHandler,
    ExecutorReference,
    QosEventHandler,
    ServiceHandler,
    SubscriptionHandler,
    TimerHandler,
)
from obelisk_py.core.executor.simulated_timers import SimulatedTimerHandler, SimulatedTimers
from obelisk_py.core.executor.waitset_thread import (
    GuardConditionHandler,
    WaitableHandler,
    WaitSetHandler,
    WaitSetThread,
)
from obelisk_py.core.executor.worker import Job, TaskQueue, Worker
from obelisk_py.core.shared_clock import SharedClock

__all__ = ["EventLoopExecutor"]

# epoll limits the timeout; longer waits are split.
_LONGEST_WAIT_S = 3600.0
_END_OF_PROCESS_S = 2.0
_DRAIN_PERIOD_S = 0.002


class EventLoopExecutor(Executor):
    """An rclpy executor for high-rate loops."""

    def __init__(self, num_threads: int = 1, *, context: Context | None = None) -> None:
        """Create an executor without nodes.

        Args:
            num_threads: number of mutually exclusive callback groups that can run in parallel, each
                on its own thread; at least 1. If it is above 1, the same number of further threads
                runs the callbacks of reentrant groups.
            context: None uses the default context.

        Raises:
            ValueError: `num_threads` below 1.
        """
        context = get_default_context() if context is None else context
        # Created before the base class is initialized, because its constructor may call `wake`.
        self._pool = _WorkerPool(num_threads, context, weakref.ref(self))
        super().__init__(context=context)
        if num_threads < 1:
            self._pool.close()
            raise ValueError(f"num_threads is {num_threads}, expected at least 1")
        # Stops the threads when the process exits if the program never calls `shutdown`.
        self._finalizer = weakref.finalize(self, self._pool.stop, _END_OF_PROCESS_S)

    def follow(self, page: ClockPage) -> None:
        """Run timers on the simulated time of a clock page; call this before the first spin."""
        self._pool.follow(page)

    def wake(self) -> None:
        """Make a spinning thread check for changed entities or a completed future."""
        self._pool.interrupt(entities_changed=True)

    def add_node(self, node: Node) -> bool:
        """Start running a node's callbacks; false if the node was already added."""
        added = bool(super().add_node(node))
        self.wake()
        return added

    def remove_node(self, node: Node) -> None:
        """Stop running a node's callbacks."""
        super().remove_node(node)
        self.wake()
        self._pool.sync()

    def create_task(
        self, callback: Callable[..., Any] | Coroutine[Any, Any, Any], *args: Any, **kwargs: Any
    ) -> Task:
        """Schedule a function or coroutine to run while this executor spins; thread-safe.

        Returns:
            A future for the result.
        """
        task = Task(callback, args, kwargs, executor=self)
        self._pool.task_queue.put(partial(_run_task, task))
        return task

    def spin(self) -> None:
        """Run callbacks until `shutdown` is called or the context is shut down."""
        with self._spinning() as worker:
            self._run(worker, None, None)

    def spin_until_future_complete(self, future: Future, timeout_sec: float | None = None) -> None:
        """Run callbacks until a future is done or canceled.

        Args:
            future: the future to wait for.
            timeout_sec: maximum time to wait [s]; no limit if None or negative.
        """
        with self._spinning() as worker, self._woken_by(future):
            self._run(worker, future, _end_s(timeout_sec))

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait for one callback and run it.

        Args:
            timeout_sec: maximum time to wait [s]; no limit if None or negative.

        Raises:
            ExternalShutdownException: the context was shut down.
        """
        with self._spinning() as worker:
            self._run_once(worker, None, _end_s(timeout_sec))

    def spin_once_until_future_complete(
        self, future: Future, timeout_sec: float | TimeoutObject | None = None
    ) -> None:
        """Like `spin_once`, but stop waiting when the future is done.

        Raises:
            ExternalShutdownException: the context was shut down.
        """
        timeout_s = timeout_sec.timeout if isinstance(timeout_sec, TimeoutObject) else timeout_sec
        with self._spinning() as worker, self._woken_by(future):
            self._run_once(worker, future, _end_s(timeout_s))

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Stop spinning and release all nodes.

        If called within a callback, it returns immediately and the executor stops after the
        callback.

        Args:
            timeout_sec: maximum time to wait for running callbacks [s]; no limit if None or
                negative.

        Returns:
            Whether everything stopped in time.
        """
        timeout_s = None if timeout_sec is None or timeout_sec < 0 else timeout_sec
        self._is_shutdown = True
        ended = self._pool.stop(timeout_s)
        if ended:
            # Does not call the base class, because that destroys a guard condition. If rclpy's
            # signal thread triggered the destroyed condition, the process would crash.
            with self._nodes_lock:
                self._nodes = set()
        return ended

    def _run(self, worker: Worker, future: Future | None, end_s: float | None) -> None:
        wait_s = -1.0
        while True:
            if worker.is_interrupted:
                worker.is_interrupted = False
                if not self._should_continue():
                    return
                self._pool.run_posted(worker)
                # When the future completes, it interrupts the worker; see `_woken_by`.
                if future is not None and _is_done(future):
                    return
            if end_s is not None:
                wait_s = _wait_s(end_s)
                if wait_s == 0:
                    return
            worker.run_ready(wait_s)

    def _run_once(self, worker: Worker, future: Future | None, end_s: float | None) -> None:
        ran = False
        while not ran:
            if worker.is_interrupted:
                worker.is_interrupted = False
                if not self._should_continue():
                    if not self._context.ok():
                        raise ExternalShutdownException
                    return
                ran = self._pool.run_posted(worker)
            wait_s = -1.0 if end_s is None else _wait_s(end_s)
            ran = ran or (future is not None and _is_done(future)) or worker.run_one(wait_s)
            if wait_s == 0:
                return

    def _should_continue(self) -> bool:
        pool = self._pool
        if pool.fault is not None:
            fault, pool.fault = pool.fault, None
            raise fault
        return not pool.is_stopped and bool(self._context.ok())

    @contextmanager
    def _spinning(self) -> Iterator[Worker]:
        pool = self._pool
        if not pool.spinning.acquire(blocking=False):
            raise RuntimeError("this executor is already spinning")
        try:
            pool.start()
            yield pool.worker
        finally:
            pool.pause()
            if pool.is_stopped:
                pool.close()
            pool.spinning.release()

    @contextmanager
    def _woken_by(self, future: Future) -> Iterator[None]:
        def wake(_future: Future) -> None:
            self._pool.interrupt(entities_changed=False)

        if not _is_done(future):
            future.add_done_callback(wake)
        try:
            yield
        finally:
            future.remove_done_callback(wake)


def _run_task(task: Task, worker: Worker) -> bool:
    worker.run_task(task, None)
    return True


def _is_done(future: Future) -> bool:
    return bool(future.done() or future.cancelled())


def _end_s(timeout_s: float | None) -> float | None:
    """End of a wait on the monotonic clock [s]; None if it has no limit."""
    return None if timeout_s is None or timeout_s < 0 else time.monotonic() + timeout_s


def _wait_s(end_s: float) -> float:
    return min(max(0.0, end_s - time.monotonic()), _LONGEST_WAIT_S)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Roles:
    """Which workers run what.

    Reentrant callbacks have workers of their own, so they never delay an exclusive group, for whose
    callbacks they may be waiting.
    """

    exclusive: tuple[Worker, ...]
    """Run mutually exclusive callback groups; the first one belongs to the thread that spins."""
    reentrant: tuple[Worker, ...]
    """Run reentrant groups and tasks of the executor."""
    reader: Worker
    """Reads the sockets of reentrant subscriptions."""

    @classmethod
    def single(cls) -> Self:
        """One worker for everything."""
        worker = Worker()
        return cls(exclusive=(worker,), reentrant=(worker,), reader=worker)

    @classmethod
    def parallel(cls, count: int) -> Self:
        """`count` workers of either kind."""
        first, second = (tuple(Worker() for _ in range(count)) for _ in range(2))
        return cls(exclusive=first, reentrant=second, reader=Worker())


class _WorkerPool:
    """The workers of an executor; the thread that spins runs the first one.

    Each other worker has its own thread, which runs only while the executor spins.
    """

    def __init__(
        self,
        num_threads: int,
        context: Context,
        executor: ExecutorReference,
    ) -> None:
        """Create the workers without starting them.

        Args:
            num_threads: as for `EventLoopExecutor`.
            context: its shutdown interrupts the first worker.
            executor: the executor whose nodes the workers run.
        """
        self.spinning = threading.Lock()
        """Held by the thread that spins."""
        self.is_stopped = False
        self.fault: BaseException | None = None
        """Exception raised by a callback on another worker or by the wait set's thread."""
        self.task_queue = TaskQueue()
        self._is_closed = False
        self._executor = executor
        roles = _Roles.parallel(num_threads) if num_threads > 1 else _Roles.single()
        self._workers = tuple(dict.fromkeys((*roles.exclusive, *roles.reentrant, roles.reader)))
        for worker in roles.reentrant:
            worker.add(self.task_queue, shared=num_threads > 1)
        self._waitset = WaitSetThread(context, self._on_event)
        self._registry = _HandlerRegistry(roles, self.task_queue, self._waitset, executor)
        self._may_run = threading.Event()
        self._threads: tuple[threading.Thread, ...] = ()
        self._drain_lock = threading.Lock()
        self._idle: set[Worker] = set()
        """Workers that have stopped and are not running a callback."""

    def follow(self, page: ClockPage) -> None:
        """Run timers on the simulated time of a clock page."""
        timers = SimulatedTimers(page)
        for worker in self._workers:
            worker.add(timers, shared=len(self._workers) > 1)
        self._registry.simulated_timers = timers

    @property
    def worker(self) -> Worker:
        """The worker of the thread that spins."""
        return self._workers[0]

    def interrupt(self, *, entities_changed: bool) -> None:
        """Make all workers return to `run_posted`."""
        if entities_changed:
            self._registry.is_outdated = True
        for worker in self._workers:
            worker.interrupt()

    def run_posted(self, worker: Worker) -> bool:
        """Do a worker's work after an interrupt; true if a user callback ran."""
        if self._registry.is_outdated:
            self._update()
        return worker.run_posted()

    def sync(self) -> None:
        """Apply changes to the nodes now, unless another thread is spinning and will apply them."""
        with self._registry.lock:
            if self.worker.thread_id is None and not self.is_stopped:
                self._update()

    def start(self) -> None:
        """Run the first worker on the calling thread, which holds `spinning`."""
        self._own(self.worker)
        self.worker.is_interrupted = True
        if self.is_stopped:
            return
        self._waitset.start()
        if len(self._workers) > 1 and not self._threads:
            self._threads = tuple(
                threading.Thread(target=self._work, args=(worker,), name=f"worker {n}", daemon=True)
                for n, worker in enumerate(self._workers[1:], start=1)
            )
            for thread in self._threads:
                thread.start()
        self._may_run.set()

    def pause(self) -> None:
        """Detach the calling thread and let the other workers pause after their callbacks."""
        self._may_run.clear()
        for worker in self._workers[1:]:
            worker.interrupt()
        self._disown(self.worker)

    def stop(self, timeout_s: float | None) -> bool:
        """Stop all threads and release everything; false if that takes longer than `timeout_s`.

        If called within a callback, it only requests the stop, which happens after the callback.
        """
        self.is_stopped = True
        self._may_run.set()
        self.interrupt(entities_changed=False)
        if threading.get_ident() in [worker.thread_id for worker in self._workers]:
            return True
        end_s = None if timeout_s is None else time.monotonic() + timeout_s
        if not self.spinning.acquire(timeout=-1 if timeout_s is None else timeout_s):
            return False
        try:
            return self.close(end_s)
        finally:
            self.spinning.release()

    def close(self, end_s: float | None = None) -> bool:
        """Release everything after a stop; the calling thread holds `spinning`.

        Args:
            end_s: when to stop waiting for threads, on the monotonic clock [s].

        Returns:
            Whether all threads have ended.
        """
        if self._threads:
            with self._running(self.worker):
                self._drain(self.worker, end_s)
        for thread in self._threads:
            thread.join(_left_s(end_s))
        if any(thread.is_alive() for thread in self._threads):
            return False
        if not self._is_closed:
            if not self._waitset.stop(_left_s(end_s)):
                return False
            self._is_closed = True
            self._registry.clear()
            for worker in self._workers:
                worker.remove(self.task_queue)
                if self._registry.simulated_timers is not None:
                    worker.remove(self._registry.simulated_timers)
                worker.close()
            self.task_queue.close()
        return True

    def _update(self) -> None:
        executor = self._executor()
        self._registry.update(executor.get_nodes() if executor is not None else ())

    def _work(self, worker: Worker) -> None:
        while not self.is_stopped:
            self._may_run.wait()
            with self._running(worker):
                while self._may_run.is_set() and not self.is_stopped:
                    if worker.is_interrupted:
                        worker.is_interrupted = False
                        self.run_posted(worker)
                    worker.run_ready(-1)
        with self._running(worker):
            self._drain(worker, None)

    @contextmanager
    def _running(self, worker: Worker) -> Iterator[None]:
        self._own(worker)
        try:
            yield
        except BaseException as fault:  # the thread that spins re-raises it
            worker.is_interrupted = True
            self._on_event(fault)
        finally:
            self._disown(worker)

    def _drain(self, worker: Worker, end_s: float | None) -> None:
        """After a stop, handle events until the callbacks on other workers have ended.

        They may be waiting for these events, such as the response of a service.
        """
        worker.ignore_unawaited()
        try:
            while not self._is_drained(worker) and _left_s(end_s) != 0:
                time.sleep(_DRAIN_PERIOD_S)
                with self._drain_lock:
                    self._idle.discard(worker)
                worker.is_interrupted = False
                worker.run_posted()
                worker.run_ready(0)
        finally:
            self._idle.add(worker)

    def _is_drained(self, worker: Worker) -> bool:
        """Mark a worker as idle, and return whether all are."""
        with self._drain_lock:
            self._idle.add(worker)
            return len(self._idle) == len(self._workers)

    def _own(self, worker: Worker) -> None:
        with self._registry.lock:
            worker.thread_id = threading.get_ident()

    def _disown(self, worker: Worker) -> None:
        with self._registry.lock:
            worker.thread_id = None
            self._registry.release(worker)

    def _on_event(self, fault: BaseException | None) -> None:
        self.fault = self.fault or fault
        self.worker.interrupt()


def _left_s(end_s: float | None) -> float | None:
    return None if end_s is None else max(0.0, end_s - time.monotonic())


class _HandlerRegistry:
    """The handlers of all entities, kept in sync with the nodes.

    A mutually exclusive callback group stays on one worker, so exclusion costs nothing. Reentrant
    groups share other workers, if there are several. To retire a handler, the registry disables it
    immediately, removes it from each worker on the worker's own thread, and closes it after the
    last removal.
    """

    def __init__(
        self,
        roles: _Roles,
        task_queue: TaskQueue,
        waitset: WaitSetThread,
        executor: ExecutorReference,
    ) -> None:
        self.is_outdated = False
        """Whether entities were added or destroyed since the last `update`."""
        self.lock = threading.RLock()
        """Held while a worker gets or loses its thread, so that `update` sees a stable state."""
        self.simulated_timers: SimulatedTimers | None = None
        """None if the executor does not follow a clock page."""
        self._roles = roles
        self._task_queue = task_queue
        self._waitset = waitset
        self._executor = executor
        # Keyed by `id`; a handler keeps its entity alive, so the id is not reused.
        self._handlers: dict[int, EntityHandler] = {}
        self._retiring: dict[EntityHandler, set[Worker]] = {}
        self._waitset_handlers: dict[int, WaitSetHandler] = {}
        self._groups: weakref.WeakKeyDictionary[CallbackGroup, Worker] = weakref.WeakKeyDictionary()

    def update(self, nodes: Iterable[Any]) -> None:
        """Add handlers for new entities and remove those whose entity was destroyed."""
        with self.lock:
            self.is_outdated = False
            listed = {id(entity): (make, entity) for make, entity in self._entities(nodes)}
            for key in self._handlers.keys() - listed.keys():
                self._retire(self._handlers.pop(key))
            for key in listed.keys() - self._handlers.keys():
                self._add(key, *listed[key])
            self._update_waitset(nodes)

    def clear(self) -> None:
        """Remove every handler; call this only while no worker has a thread."""
        self.update(())
        for worker in {worker for workers in self._retiring.values() for worker in workers}:
            self.release(worker)

    def release(self, worker: Worker) -> None:
        """Remove retiring handlers from a worker that no thread runs."""
        with self.lock:
            for handler in list(self._retiring):
                self._remove(handler, worker)

    def _add(self, key: int, make: Callable[..., EntityHandler], entity: Any) -> None:
        try:
            handler = make(entity, self._executor)
        except InvalidHandle:  # the entity was destroyed in the meantime
            return
        try:
            handler.enable()
        except RuntimeError as error:
            handler.disable()  # otherwise its listener would write to a closed descriptor
            handler.close()
            if isinstance(error, InvalidHandle):
                return
            raise
        workers = self._workers_of(handler.group)
        handler.is_shared = len(workers) > 1
        for worker in workers:
            worker.add(handler, shared=handler.is_shared)
        for source in handler.unshared_sources:
            self._reader_of(handler).add(source, shared=False)
        self._handlers[key] = handler

    def _retire(self, handler: EntityHandler) -> None:
        handler.disable()
        workers = {*self._workers_of(handler.group), self._reader_of(handler)}
        self._retiring[handler] = set(workers)
        for worker in workers:
            if worker.thread_id in (None, threading.get_ident()):
                self._remove(handler, worker)
            else:
                worker.post(partial(self._remove, handler))

    def _remove(self, handler: EntityHandler, worker: Worker) -> bool:
        with self.lock:
            workers = self._retiring.get(handler, set())
            if worker in workers:
                for source in (handler, *handler.unshared_sources):
                    worker.remove(source)
                workers.remove(worker)
                if not workers:
                    del self._retiring[handler]
                    handler.close()
        return False

    def _workers_of(self, group: CallbackGroup) -> Sequence[Worker]:
        if isinstance(group, ReentrantCallbackGroup):
            return self._roles.reentrant
        return [self._worker_of(group)]

    def _reader_of(self, handler: EntityHandler) -> Worker:
        """Return the worker of a handler's unshared sources."""
        return self._roles.reader if handler.is_shared else self._workers_of(handler.group)[0]

    def _worker_of(self, group: CallbackGroup) -> Worker:
        """Return a group's worker; a new group gets the worker with the fewest groups."""
        if group not in self._groups:
            taken = list(self._groups.values())
            self._groups[group] = min(self._roles.exclusive, key=taken.count)
        return self._groups[group]

    def _entities(self, nodes: Iterable[Any]) -> Iterator[tuple[Callable[..., EntityHandler], Any]]:
        for node in nodes:
            for make, entities in (
                (self._timer_handler, node.timers),
                (partial(SubscriptionHandler, node=node), node.subscriptions),
                (ServiceHandler, node.services),
                (ClientHandler, node.clients),
                (QosEventHandler, [w for w in node.waitables if isinstance(w, EventHandler)]),
            ):
                for entity in list(entities):
                    yield make, entity

    def _timer_handler(self, timer: Any, executor: ExecutorReference) -> EntityHandler:
        if self.simulated_timers is None or not isinstance(timer.clock, SharedClock):
            return TimerHandler(timer, executor)
        return SimulatedTimerHandler(timer, executor, timers=self.simulated_timers)

    def _update_waitset(self, nodes: Iterable[Any]) -> None:
        listed = {id(entity): (make, entity) for make, entity in _waitset_entities(nodes)}
        missing = self._waitset_handlers.keys() - listed.keys()
        new = listed.keys() - self._waitset_handlers.keys()
        for key in missing:
            self._waitset_handlers.pop(key).is_destroyed = True
        for key in new:
            make, entity = listed[key]
            post = self._post_to(entity.callback_group)
            self._waitset_handlers[key] = make(entity, post, self._executor, self._waitset.wake)
        if missing or new:
            self._waitset.watch(tuple(self._waitset_handlers.values()))

    def _post_to(self, group: CallbackGroup) -> Callable[[Job], None]:
        if isinstance(group, ReentrantCallbackGroup):
            return self._task_queue.put
        return partial(self._worker_of(group).post, group=group)


def _waitset_entities(nodes: Iterable[Any]) -> Iterator[tuple[type[WaitSetHandler], Any]]:
    for node in nodes:
        for guard in list(node.guards):
            yield GuardConditionHandler, guard
        for waitable in list(node.waitables):
            if not isinstance(waitable, EventHandler):
                yield WaitableHandler, waitable
