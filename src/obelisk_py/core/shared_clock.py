"""Make a node's clock follow the clock page of its launch instead of messages on `/clock`.

rclpy's `TimeSource` subscribes a node with `use_sim_time` to `/clock`. In a process with a clock
page, a `ClockFeed` replaces this subscription: `now()` reads the page. rcl keeps a copy of the time
for timers and jump callbacks, which is updated when one of them needs it.
"""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Final

from rclpy.clock import ROSClock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.exceptions import NotInitializedException
from rclpy.time import Time
from rclpy.time_source import TimeSource
from rclpy.timer import Timer
from rclpy.utilities import get_default_context

from obelisk_py.core.clock_page import ClockPage

__all__ = [
    "ClockFeed",
    "SharedClock",
    "is_of_time_source",
    "new_nodes_follow",
    "page_to_follow",
    "share_timer",
]

_SHORTEST_POLL_S: Final = 0.0002
_LONGEST_POLL_S: Final = 0.002
_NS_PER_S: Final = 1_000_000_000

_page: ContextVar[ClockPage | None] = ContextVar("clock_page", default=None)


@contextmanager
def new_nodes_follow(page: ClockPage | None) -> Iterator[None]:
    """Make new nodes follow this page inside the `with` block, if they use simulated time."""
    token = _page.set(page)
    try:
        yield
    finally:
        _page.reset(token)


def page_to_follow() -> ClockPage | None:
    """Return the page that new nodes with simulated time follow, or None."""
    return _page.get()


class SharedClock(ROSClock):
    """The clock of a node that follows a clock page; `ClockFeed` converts the node's clock."""

    page: ClockPage
    synced_ns: int
    """The time that rcl has [ns]; -1 before the first `sync`."""
    _lock: threading.Lock

    def now(self) -> Time:
        """Return the simulated time."""
        return Time(nanoseconds=self.page.time_ns, clock_type=ClockType.ROS_TIME)

    def sync(self) -> int:
        """Set rcl's time to the current one, which runs jump callbacks, and return it [ns]."""
        # Locked, because setting an older time last would look like a jump back.
        with self._lock:
            now_ns = self.page.time_ns
            if now_ns != self.synced_ns:
                self.synced_ns = now_ns
                self.set_ros_time_override(Time(nanoseconds=now_ns, clock_type=ClockType.ROS_TIME))
        return now_ns

    def sleep_until(self, until: Time, context: Context | None = None) -> bool:
        """Like rclpy's; false if the time jumped back in the meantime.

        Raises:
            ValueError: `until` has a different clock type.
            NotInitializedException: the context is not running.
        """
        context = get_default_context() if context is None else context
        if not context.ok():
            raise NotInitializedException
        if until.clock_type != self.clock_type:
            raise ValueError("until's clock type does not match this clock's type")
        page, epoch = self.page, self.page.epoch
        while (left_ns := until.nanoseconds - page.time_ns) > 0:
            if not context.ok() or page.epoch != epoch or not self.ros_time_is_active:
                return False
            # Polls, because the executor handles wake-ups and may be waiting for this call.
            time.sleep(min(max(left_ns / _NS_PER_S, _SHORTEST_POLL_S), _LONGEST_POLL_S))
        return True


class SharedTimer(Timer):
    """A timer on a `SharedClock`; `share_timer` converts rclpy's timer."""

    def reset(self) -> None:
        """Start a new period now."""
        self._sync()
        super().reset()

    def is_ready(self) -> bool:
        """Whether the timer is due."""
        self._sync()
        return bool(super().is_ready())

    def time_since_last_call(self) -> int:
        """Simulated time since the last call [ns]."""
        self._sync()
        return int(super().time_since_last_call())

    def time_until_next_call(self) -> int | None:
        """Simulated time until the next call [ns]; None if the timer is canceled."""
        self._sync()
        left_ns: int | None = super().time_until_next_call()
        return left_ns

    def _sync(self) -> None:
        if isinstance(self.clock, SharedClock):
            self.clock.sync()


class ClockFeed:
    """Replaces a `TimeSource`'s subscription to `/clock`."""

    def __init__(self, clock: Any, page: ClockPage) -> None:
        """Make a node's clock follow the page."""
        # rclpy creates a node's clock itself and stores it in several places.
        clock.__class__ = SharedClock
        clock.page, clock.synced_ns, clock._lock = page, -1, threading.Lock()
        page.followers.add(clock)
        self._clock = clock

    def close(self) -> None:
        """Convert the clock back to rclpy's, after the node has turned simulated time off."""
        self._clock.page.followers.discard(self._clock)
        self._clock.__class__ = ROSClock


def is_of_time_source(callback: Any) -> bool:
    """Whether a callback is a `TimeSource`'s callback for `/clock`."""
    return isinstance(getattr(callback, "__self__", None), TimeSource)


def share_timer(timer: Timer) -> None:
    """Make a new timer's methods use the current time, if its clock follows a page."""
    if isinstance(timer.clock, SharedClock):
        timer.__class__ = SharedTimer
