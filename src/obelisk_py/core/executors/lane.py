"""One thread's share of an executor's work: an epoll over descriptors, each with a handler.

Descriptors with handlers come in, jobs posted by other threads, and callbacks that are coroutines;
out come calls, one after another, on the thread that calls `attend` and `run_ready`. A lane waits
for nothing but its epoll, and starts no thread.
"""

import os
import select
import threading
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Protocol

from rclpy.callback_groups import CallbackGroup, ReentrantCallbackGroup
from rclpy.task import Task

from obelisk_py.core.executors.listeners import open_signal

__all__ = ["Handler", "Job", "Lane", "Watched"]

Handler = Callable[[], bool]
"""Runs what is ready; true if a callback of the user ran."""

Job = Callable[["Lane"], bool]
"""What another thread asks a lane to run; true if a callback of the user ran."""

_EDGE = select.EPOLLIN | select.EPOLLET
_SHORTEST_LOOK_S, _LONGEST_LOOK_S = 0.001, 0.016


class Watched(Protocol):
    """What a lane watches: descriptors and handlers that belong together."""

    group: CallbackGroup | None
    waits_for_group: bool
    """Does not run while a coroutine of its mutually exclusive group is suspended."""

    def handlers(self, lane: "Lane") -> Mapping[int, Handler]:
        """By descriptor, what the lane calls when it is signalled."""


class Lane:
    """The handlers of one thread."""

    def __init__(self) -> None:
        self.attention = False
        """Set by `call`, cleared by who then attends: handlers return after their callback."""
        self.thread_id: int | None = None
        """The thread that runs the lane, None while none does."""
        self._epoll = select.epoll()
        self._handlers: dict[int, Handler] = {}
        self._watched: dict[int, tuple[Watched, Handler]] = {}
        self._ready: deque[int] = deque()
        self._jobs: deque[tuple[CallbackGroup | None, Job]] = deque()
        self._suspended: list[tuple[Task, CallbackGroup | None]] = []
        self._held: dict[CallbackGroup, set[int]] = {}
        self._look_s = _SHORTEST_LOOK_S
        self._closing = threading.Lock()
        self._wake_fd = open_signal()
        self._epoll.register(self._wake_fd, _EDGE)

    # --- from any thread

    def call(self) -> None:
        """Let the lane come to `attend` as soon as the callback that it is in is over."""
        self.attention = True
        with self._closing:
            if not self._epoll.closed:
                os.eventfd_write(self._wake_fd, 1)

    def post(self, job: Job, group: CallbackGroup | None = None) -> None:
        """Let the lane run a job, not while a coroutine of its exclusive group is suspended."""
        self._jobs.append((group, job))
        self.call()

    def signal(self, fd: int) -> None:
        """Have the handler of an eventfd called; without the kernel from the lane's own thread."""
        if self.thread_id == threading.get_ident():
            self._ready.append(fd)
        else:
            os.eventfd_write(fd, 1)

    def add(self, watched: Watched, *, shared: bool) -> None:
        """Watch descriptors; those of a `shared` one wake only one of the lanes that wait."""
        flags = _EDGE | select.EPOLLEXCLUSIVE if shared else _EDGE
        for fd, handler in watched.handlers(self).items():
            self._watched[fd] = (watched, handler)
            self._handlers[fd] = self._held_or(fd)
            self._epoll.register(fd, flags)

    # --- from the lane's own thread, or from any while none runs it

    def remove(self, watched: Watched) -> None:
        """Watch these descriptors no longer."""
        for fd in [fd for fd, (other, _) in list(self._watched.items()) if other is watched]:
            del self._watched[fd], self._handlers[fd]
            self._epoll.unregister(fd)

    def again(self, fd: int) -> None:
        """Call the handler of this descriptor once more, after the others had a turn."""
        self._ready.append(fd)

    def attend(self) -> bool:
        """Run what was posted; true if a callback of the user ran."""
        ran = False
        for _ in range(len(self._jobs)):
            group, job = self._jobs.popleft()
            if group in self._held:
                self._jobs.append((group, job))
            else:
                ran = job(self) or ran
        return ran

    def run_ready(self, timeout_s: float) -> bool:
        """Wait until a descriptor is signalled, then call the handlers of all that are.

        Comes back early when called upon; what was not run then is run the next time.

        Args:
            timeout_s: wait no longer than this [s]; without end if below 0.

        Returns:
            Whether a callback of the user ran.
        """
        if self._suspended:
            timeout_s = self._resume(timeout_s)
        ready = self._ready
        for fd, _ in self._epoll.poll(0 if ready or self.attention else timeout_s):
            ready.append(fd)
        ran = False
        # Only as many as are ready now: one that asks for more takes its turn after a new poll.
        for _ in range(len(ready)):
            if self.attention:
                break
            if self._handle(ready.popleft()):
                ran = True
        return ran

    def run_one(self, timeout_s: float) -> bool:
        """As `run_ready`, but at most one callback."""
        if self._suspended:
            timeout_s = self._resume(timeout_s)
        ready = self._ready
        events = self._epoll.poll(0 if ready or self.attention else timeout_s)
        ready.extend(fd for fd, _ in events)
        ran = False
        while ready and not ran:
            # A handler that would go on with the next message stops when there is attention.
            self.attention = True
            ran = self._handle(ready.popleft())
        return ran

    def begin(self, task: Task, group: CallbackGroup | None) -> None:
        """Run a task; if it is a coroutine that suspends itself, resume it from time to time.

        Until it is over, an exclusive group of it is held.

        Raises:
            BaseException: what the task raised.
        """
        task()
        if _is_over(task):
            _raise_fault(task)
            return
        if isinstance(group, ReentrantCallbackGroup):
            group = None
        self._suspended.append((task, group))
        self._look_s = _SHORTEST_LOOK_S
        if group is not None:
            self._hold(group)

    def close(self) -> None:
        """Close the epoll; from now on `call` does nothing."""
        with self._closing:
            self._epoll.close()
            os.close(self._wake_fd)

    def _handle(self, fd: int) -> bool:
        handler = self._handlers.get(fd)
        try:
            return handler is not None and handler()
        except BaseException:
            # It may have left something untaken, for which no new signal comes.
            self._ready.append(fd)
            raise

    # --- suspended coroutines

    def _resume(self, timeout_s: float) -> float:
        """Let suspended coroutines go on, and tell how long the lane may wait [s].

        What a coroutine awaits may be set by a thread that tells nobody, so they are looked at
        after every round, and now and then while nothing happens.
        """
        before = len(self._suspended)
        for task, group in list(self._suspended):
            if not _is_over(task):
                task()
            if _is_over(task):
                self._suspended.remove((task, group))
                if group is not None:
                    self._release(group)
                _raise_fault(task)
        if len(self._suspended) != before:
            self._look_s = _SHORTEST_LOOK_S
            return 0
        look_s, self._look_s = self._look_s, min(self._look_s * 2, _LONGEST_LOOK_S)
        return look_s if timeout_s < 0 else min(look_s, timeout_s)

    def _hold(self, group: CallbackGroup) -> None:
        self._held.setdefault(group, set())
        for fd in list(self._watched):
            self._handlers[fd] = self._held_or(fd)
        self.attention = True

    def _release(self, group: CallbackGroup) -> None:
        if any(other is group for _, other in self._suspended):
            return
        self._ready.extend(self._held.pop(group))
        for fd in list(self._watched):
            self._handlers[fd] = self._held_or(fd)
        self.attention = True

    def _held_or(self, fd: int) -> Handler:
        watched, handler = self._watched[fd]
        if watched.waits_for_group and watched.group in self._held:
            return partial(_keep, self._held[watched.group], fd)
        return handler


def _keep(held: set[int], fd: int) -> bool:
    held.add(fd)
    return False


def _is_over(task: Task) -> bool:
    return bool(task.done() or task.cancelled())


def _raise_fault(task: Task) -> None:
    fault = task.exception()
    if fault is not None:
        raise fault
