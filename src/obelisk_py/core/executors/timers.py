"""The runner of timers: an rcl timer's schedule, kept by a kernel timer.

The kernel timer is set to the rcl timer's next call and period. It is set anew when the rcl timer
is reset, cancelled or given another period, and when simulated time moves.
"""

import inspect
import os
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from rclpy.clock import JumpThreshold
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.timer import Timer

from obelisk_py.core.executors.entities import ExecutorReference, Runner
from obelisk_py.core.executors.lane import Handler, Lane
from obelisk_py.core.executors.listeners import EntityKind, arm_timer, open_timer

__all__ = ["TimerRunner"]

RCLError: Any = rclpy_implementation.RCLError
_AT_ONCE_NS = 1
_ANY_JUMP = JumpThreshold(
    min_forward=Duration(nanoseconds=1), min_backward=Duration(nanoseconds=-1), on_clock_change=True
)


class TimerRunner(Runner):
    """Calls the user at each period; the eventfd of the base says that the timer was reset."""

    kind = EntityKind.TIMER_RESET

    def __init__(self, entity: Timer, executor: ExecutorReference) -> None:
        super().__init__(entity, executor)
        clock = entity.clock
        steady = clock.clock_type == ClockType.STEADY_TIME
        self._kernel_clock = time.CLOCK_MONOTONIC if steady else time.CLOCK_REALTIME
        self._ros_clock = clock if clock.clock_type == ClockType.ROS_TIME else None
        self._timer_fd = open_timer(self._kernel_clock)
        self._arming = threading.Lock()
        self._is_closed = False
        self._period_ns = 0
        self._callback: Callable[[], Any] | None = None
        self._jump = self._ros_clock and self._ros_clock.create_jump_callback(
            _ANY_JUMP, post_callback=lambda _jump: self._arm()
        )

    def listen(self) -> None:
        """Begin to follow the timer's schedule."""
        super().listen()
        self._arm()

    def handlers(self, lane: Lane) -> Mapping[int, Handler]:
        """What a lane calls when the timer is due, and when it was reset."""
        return {self._timer_fd: partial(self._run, lane), self._signal_fd: self._follow}

    def close(self) -> None:
        """Let go of the timer, its clock and the kernel's timer."""
        if self._jump is not None:
            self._jump.unregister()
        with self._arming:
            self._is_closed = True
            os.close(self._timer_fd)
        super().close()

    def _follow(self) -> bool:
        self._arm()
        return False

    def _arm(self) -> None:
        """Set the kernel's timer to the schedule that the rcl timer has now."""
        with self._arming:
            if self._is_closed:
                return
            self._period_ns = self._handle.get_timer_period()
            left_ns = self._handle.time_until_next_call()
            if left_ns is None:  # cancelled
                first_ns, period_ns = 0, 0
            elif self._ros_clock is not None and self._ros_clock.ros_time_is_active:
                # Simulated time: due now, or looked at again when time has moved.
                first_ns, period_ns = (_AT_ONCE_NS if left_ns <= 0 else 0), 0
            else:
                # The clock is read after the time left, so that the timer is due when it expires.
                now_ns = time.clock_gettime_ns(self._kernel_clock)
                first_ns, period_ns = max(now_ns + left_ns, _AT_ONCE_NS), self._period_ns
            arm_timer(self._timer_fd, first_ns, period_ns)

    def _run(self, lane: Lane) -> bool:
        try:
            os.read(self._timer_fd, 8)  # lets the kernel's timer go on
        except BlockingIOError:
            return False  # set anew meanwhile, or taken by another lane
        handle = self._handle
        if not handle.is_timer_ready():
            return self._follow()
        try:
            handle.call_timer()
        except RCLError:  # cancelled in this moment, by another thread
            return self._follow()
        callback = self.entity.callback
        if callback is not self._callback:
            self._callback = callback
            self._is_coroutine = inspect.iscoroutinefunction(callback)
        if self._is_coroutine:
            self._begin(lane, callback)
        else:
            callback()
        if handle.get_timer_period() != self._period_ns:
            self._arm()
        return True
