"""Run the callbacks of one thread of an executor with epoll.

Other threads can post jobs to a worker and interrupt it. The worker runs everything on its own
thread, one job at a time. It blocks only in `epoll_wait` and starts no threads. The `TaskQueue`
holds jobs that are not bound to a worker; any idle worker takes them.
"""

import os
import select
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Protocol

from rclpy.callback_groups import CallbackGroup, ReentrantCallbackGroup
from rclpy.task import Task

from obelisk_py.core.executor.rcl_listeners import open_eventfd

__all__ = ["EventSource", "Job", "ReadyCallback", "TaskQueue", "Worker"]

ReadyCallback = Callable[[], bool]
"""Handles a ready descriptor; returns whether a user callback ran."""

Job = Callable[["Worker"], bool]
"""A job posted by another thread; returns whether a user callback ran."""

_EDGE = select.EPOLLIN | select.EPOLLET
_SHORTEST_POLL_S, _LONGEST_POLL_S = 0.001, 0.016


class EventSource(Protocol):
    """A group of descriptors and their callbacks that a worker watches together."""

    group: CallbackGroup | None
    waits_for_group: bool
    """Whether the callbacks wait while a coroutine of the mutually exclusive group is suspended."""
    is_awaited: bool
    """Whether a running callback may wait for its result, such as a service response."""

    def ready_callbacks(self, worker: "Worker") -> Mapping[int, ReadyCallback]:
        """The functions that the worker calls when a descriptor is signaled, by descriptor."""


class Worker:
    """Runs callbacks on one thread."""

    def __init__(self) -> None:
        self.is_interrupted = False
        """Set by `interrupt` and cleared before `run_posted`. Running callbacks return after the
        current message."""
        self.thread_id: int | None = None
        """The thread that runs the worker, or None."""
        self.waiting_since_ns = 0
        """When the thread last began to wait, on the monotonic clock."""
        self._epoll = select.epoll()
        self._callbacks: dict[int, ReadyCallback] = {}
        self._sources: dict[int, tuple[EventSource, ReadyCallback]] = {}
        self._ready: deque[int] = deque()
        self._posted: deque[tuple[CallbackGroup | None, Job]] = deque()
        self._suspended: list[tuple[Task, CallbackGroup | None]] = []
        self._blocked: dict[CallbackGroup, set[int]] = {}
        self._poll_s = _SHORTEST_POLL_S
        self._closing = threading.Lock()
        self._wake_fd = open_eventfd()
        self._epoll.register(self._wake_fd, _EDGE)

    # --- from any thread

    def interrupt(self) -> None:
        """Make the worker return to `run_posted` after its current callback."""
        self.is_interrupted = True
        with self._closing:
            if not self._epoll.closed:
                os.eventfd_write(self._wake_fd, 1)

    def post(self, job: Job, group: CallbackGroup | None = None) -> None:
        """Queue a job; it runs when no coroutine of its exclusive group is suspended."""
        self._posted.append((group, job))
        self.interrupt()

    def signal(self, fd: int) -> None:
        """Run the callback of an eventfd; on the worker's own thread, without a system call."""
        if self.thread_id == threading.get_ident():
            self._ready.append(fd)
        else:
            os.eventfd_write(fd, 1)

    def add(self, source: EventSource, *, shared: bool) -> None:
        """Watch a source; a `shared` source wakes only one of the waiting workers."""
        flags = _EDGE | select.EPOLLEXCLUSIVE if shared else _EDGE
        for fd, callback in source.ready_callbacks(self).items():
            self._watch(source, fd, callback, flags)

    def watch(self, source: EventSource, fd: int, callback: ReadyCallback) -> None:
        """Watch another descriptor of a source that only this worker watches.

        It is level-triggered: its callback runs in every round in which the descriptor is readable.
        The callbacks of other descriptors run once per signal.
        """
        self._watch(source, fd, callback, select.EPOLLIN)

    # --- from the worker's own thread, or from any thread while no thread runs the worker

    def remove(self, source: EventSource) -> None:
        """Stop watching a source."""
        for fd in [fd for fd, (other, _) in list(self._sources.items()) if other is source]:
            self.unwatch(fd)

    def unwatch(self, fd: int) -> None:
        """Stop watching a descriptor."""
        del self._sources[fd], self._callbacks[fd]
        self._epoll.unregister(fd)

    def ignore_unawaited(self) -> None:
        """Stop watching all sources that no running callback can wait for."""
        for source in {source for source, _ in list(self._sources.values())}:
            if not source.is_awaited:
                self.remove(source)

    def is_blocked(self, group: CallbackGroup) -> bool:
        """Whether callbacks of an exclusive group are waiting for a suspended coroutine."""
        return group in self._blocked

    def requeue(self, fd: int) -> None:
        """Run the callback of this descriptor again after the others have had a turn."""
        self._ready.append(fd)

    def run_posted(self) -> bool:
        """Run the posted jobs; returns whether a user callback ran."""
        ran = False
        for _ in range(len(self._posted)):
            group, job = self._posted.popleft()
            if group in self._blocked:
                self._posted.append((group, job))
            else:
                ran = job(self) or ran
        return ran

    def run_ready(self, timeout_s: float) -> bool:
        """Wait until a descriptor is ready, then run the callbacks of all that are ready.

        If interrupted, it returns early; the remaining callbacks run on the next call.

        Args:
            timeout_s: maximum wait [s]; no limit if negative.

        Returns:
            Whether a user callback ran.
        """
        if self._suspended:
            timeout_s = self._resume(timeout_s)
        ready, callbacks = self._ready, self._callbacks
        self.waiting_since_ns = time.monotonic_ns()
        for fd, _ in self._epoll.poll(0 if ready or self.is_interrupted else timeout_s):
            ready.append(fd)
        ran = False
        try:
            # Only those that are ready now: a requeued descriptor runs after the next poll.
            for _ in range(len(ready)):
                if self.is_interrupted:
                    break
                fd = ready.popleft()
                callback = callbacks.get(fd)
                if callback is not None and callback():
                    ran = True
        except BaseException:
            # Unread data may remain, and no new signal will announce it.
            ready.append(fd)
            raise
        return ran

    def run_one(self, timeout_s: float) -> bool:
        """Like `run_ready`, but run at most one callback."""
        if self._suspended:
            timeout_s = self._resume(timeout_s)
        ready = self._ready
        self.waiting_since_ns = time.monotonic_ns()
        events = self._epoll.poll(0 if ready or self.is_interrupted else timeout_s)
        # A level-triggered descriptor is reported until its callback has run.
        ready.extend(fd for fd, _ in events if fd not in ready)
        ran = False
        while ready and not ran:
            # Makes the callback return after one message.
            self.is_interrupted = True
            ran = self._handle(ready.popleft())
        return ran

    def run_task(self, task: Task, group: CallbackGroup | None) -> None:
        """Run a task; if its coroutine suspends, the worker resumes it periodically.

        A mutually exclusive group is blocked until the task is done.

        Raises:
            BaseException: the exception of the task.
        """
        task()
        if _is_done(task):
            _raise_exception(task)
            return
        if isinstance(group, ReentrantCallbackGroup):
            group = None
        self._suspended.append((task, group))
        self._poll_s = _SHORTEST_POLL_S
        if group is not None:
            self._block(group)

    def close(self) -> None:
        """Close the epoll instance; later calls to `interrupt` have no effect."""
        with self._closing:
            self._epoll.close()
            os.close(self._wake_fd)

    def _handle(self, fd: int) -> bool:
        callback = self._callbacks.get(fd)
        try:
            return callback is not None and callback()
        except BaseException:
            # Unread data may remain, and no new signal will announce it.
            self._ready.append(fd)
            raise

    def _watch(self, source: EventSource, fd: int, callback: ReadyCallback, flags: int) -> None:
        self._sources[fd] = (source, callback)
        self._callbacks[fd] = self._callback_of(fd)
        self._epoll.register(fd, flags)

    # --- suspended coroutines

    def _resume(self, timeout_s: float) -> float:
        """Resume suspended coroutines, and return how long the worker may wait [s].

        Another thread may complete an awaited future without waking the worker. Coroutines are
        therefore polled after every round, and at intervals while the worker is idle.
        """
        before = len(self._suspended)
        for task, group in list(self._suspended):
            if not _is_done(task):
                task()
            if _is_done(task):
                self._suspended.remove((task, group))
                if group is not None:
                    self._unblock(group)
                _raise_exception(task)
        if len(self._suspended) != before:
            self._poll_s = _SHORTEST_POLL_S
            return 0
        poll_s, self._poll_s = self._poll_s, min(self._poll_s * 2, _LONGEST_POLL_S)
        return poll_s if timeout_s < 0 else min(poll_s, timeout_s)

    def _block(self, group: CallbackGroup) -> None:
        self._blocked.setdefault(group, set())
        for fd in list(self._sources):
            self._callbacks[fd] = self._callback_of(fd)
        self.is_interrupted = True

    def _unblock(self, group: CallbackGroup) -> None:
        if any(other is group for _, other in self._suspended):
            return
        self._ready.extend(self._blocked.pop(group))
        for fd in list(self._sources):
            self._callbacks[fd] = self._callback_of(fd)
        self.is_interrupted = True

    def _callback_of(self, fd: int) -> ReadyCallback:
        source, callback = self._sources[fd]
        if source.waits_for_group and source.group in self._blocked:
            return partial(_defer, self._blocked[source.group], fd)
        return callback


def _defer(blocked: set[int], fd: int) -> bool:
    blocked.add(fd)
    return False


def _is_done(task: Task) -> bool:
    return bool(task.done() or task.cancelled())


def _raise_exception(task: Task) -> None:
    exception = task.exception()
    if exception is not None:
        raise exception


class TaskQueue:
    """Jobs that any worker may run: tasks of the executor and jobs of reentrant groups."""

    group: CallbackGroup | None = None
    waits_for_group = False
    is_awaited = True

    def __init__(self) -> None:
        self._jobs: deque[Job] = deque()
        self._closing = threading.Lock()
        self._signal_fd = open_eventfd()
        self._closed = False

    def put(self, job: Job) -> None:
        """Queue a job for any worker."""
        self._jobs.append(job)
        self._signal()

    def ready_callbacks(self, worker: Worker) -> Mapping[int, ReadyCallback]:
        """The queue's descriptor and its handler."""
        return {self._signal_fd: partial(self._run_one, worker)}

    def close(self) -> None:
        """Close the descriptor; jobs queued later never run."""
        with self._closing:
            self._closed = True
            os.close(self._signal_fd)

    def _signal(self) -> None:
        with self._closing:
            if not self._closed:
                os.eventfd_write(self._signal_fd, 1)

    def _run_one(self, worker: Worker) -> bool:
        try:
            job = self._jobs.popleft()
        except IndexError:
            return False
        if self._jobs:
            # The job may take a long time, so let another waiting worker take the next one.
            self._signal()
        return job(worker)
