"""Run the timers of nodes that follow a clock page on simulated time.

The simulator signals the process when its first timer is due. Any worker may handle the signal. It
wakes the due timers and writes the next due time to the page. While simulated time is paused,
nothing wakes up.
"""

import os
import threading
from collections.abc import Mapping
from typing import Final

from rclpy.callback_groups import CallbackGroup
from rclpy.logging import get_logger
from rclpy.timer import Timer

from obelisk_py.core.clock_page import NEVER_NS, ClockPage
from obelisk_py.core.executor.handlers import (
    ExecutorReference,
    RCLError,
    TimerCallbackHandler,
)
from obelisk_py.core.executor.worker import ReadyCallback, Worker
from obelisk_py.core.shared_clock import SharedClock

__all__ = ["SimulatedTimerHandler", "SimulatedTimers"]

_LOGGER: Final = "simulated_time"
_NS_PER_S: Final = 1_000_000_000


class SimulatedTimers:
    """The timers of one executor and their due times in simulated time."""

    group: CallbackGroup | None = None
    waits_for_group = False
    is_awaited = False

    def __init__(self, page: ClockPage) -> None:
        """Follow a clock page, without timers at first."""
        self._page = page
        self._dues: dict[SimulatedTimerHandler, int] = {}
        """When each timer is due [ns]."""
        self._first_ns = NEVER_NS
        """The due time known to the simulator; no timer is due earlier [ns]."""
        self._epoch = page.epoch
        self._seen_ns = page.time_ns
        # Held while timers are woken, so that none is closed meanwhile.
        self._lock = threading.Lock()

    def ready_callbacks(self, _worker: Worker) -> Mapping[int, ReadyCallback]:
        """The function that a worker calls when the simulator signals."""
        return {self._page.wake_fd: self._on_signal}

    def set_due(self, timer: "SimulatedTimerHandler", due_ns: int) -> None:
        """Wake a timer at this time [ns], or immediately if the time has passed."""
        with self._lock:
            if timer.is_removed:
                return
            self._dues[timer] = due_ns
            if due_ns < self._first_ns:
                self._first_ns = due_ns
                self._page.set_due(due_ns)
        # The step that reached this time may have missed the due time.
        if due_ns <= self._page.time_ns:
            timer.wake()

    def remove(self, timer: "SimulatedTimerHandler") -> None:
        """Remove a timer; it is not woken any more."""
        with self._lock:
            timer.is_removed = True
            self._dues.pop(timer, None)

    def _on_signal(self) -> bool:
        page, dues = self._page, self._dues
        if page.epoch != self._epoch:
            self._start_again()
            return False
        with self._lock:
            while True:
                now_ns = self._seen_ns = page.time_ns
                for timer, due_ns in dues.items():
                    if due_ns <= now_ns:
                        dues[timer] = NEVER_NS  # until it has run
                        timer.wake()
                self._first_ns = min(dues.values(), default=NEVER_NS)
                page.set_due(self._first_ns)
                if self._first_ns > page.time_ns:
                    return False

    def _start_again(self) -> None:
        """Make every clock and timer handle a jump back in time."""
        page = self._page
        before_ns, self._seen_ns, self._epoch = self._seen_ns, page.time_ns, page.epoch
        for clock in list(page.followers):
            clock.sync()
        with self._lock:
            self._first_ns = NEVER_NS
            for timer in self._dues:
                timer.wake()
        get_logger(_LOGGER).info(
            f"simulated time jumped back from {before_ns / _NS_PER_S:.3f} s to "
            f"{self._seen_ns / _NS_PER_S:.3f} s (the simulator was reset or restarted); timers "
            "were restarted"
        )


class SimulatedTimerHandler(TimerCallbackHandler):
    """Runs a timer's callback once per period of simulated time.

    The base class's eventfd is signaled when the timer is due and when it was reset.
    """

    def __init__(
        self, entity: Timer, executor: ExecutorReference, *, timers: SimulatedTimers
    ) -> None:
        """Keep the timer alive until `close`; `timers` wakes the handler."""
        super().__init__(entity, executor)
        assert isinstance(entity.clock, SharedClock)
        self._clock = entity.clock
        self._timers = timers
        self._taking = threading.Lock()
        self._worker: Worker | None = None
        self.is_removed = False
        """Whether it was removed from `timers` and is no longer woken."""

    def ready_callbacks(self, worker: Worker) -> Mapping[int, ReadyCallback]:
        """The function that a worker calls when the timer may be due."""
        self._worker = None if self.is_shared else worker
        return super().ready_callbacks(worker)

    def disable(self) -> None:
        """Clear the listener; the timer is not woken any more."""
        super().disable()
        self._timers.remove(self)

    def wake(self) -> None:
        """Make a worker run the callback if the timer is due."""
        if self._worker is None:
            os.eventfd_write(self._signal_fd, 1)
        else:
            self._worker.signal(self._signal_fd)

    def _run(self, worker: Worker) -> bool:
        handle = self._handle
        with self._taking:
            now_ns = self._clock.sync()
            is_due = bool(handle.is_timer_ready())
            if is_due:
                try:
                    handle.call_timer()
                except RCLError:  # another thread has just canceled it
                    is_due = False
            left_ns = handle.time_until_next_call()
        self._timers.set_due(self, NEVER_NS if left_ns is None else now_ns + left_ns)
        if is_due:
            self._call(worker)
        return is_due
