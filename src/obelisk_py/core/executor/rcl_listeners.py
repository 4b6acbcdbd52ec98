"""Set rcl listeners and kernel timers through ctypes; Python and rclpy have no API for them.

The middleware calls a listener when data arrives. The listener here is libc's `eventfd_write`
itself. Its signature `int (int, uint64_t)` fits `rcl_event_callback_t`, `void (const void *,
size_t)`, with the file descriptor as user data. The middleware's threads can therefore signal
without taking the GIL. This module keeps no state and never blocks.

Sources: rcl/event_callback.h and rcl/timer.h of ROS 2 Jazzy; eventfd(3), timerfd_create(2).
"""

import ctypes
import os
from enum import Enum

__all__ = [
    "EntityKind",
    "arm_timer",
    "clear_listener",
    "open_eventfd",
    "open_timer",
    "set_listener",
]


class EntityKind(Enum):
    """Kinds of entities that have a listener; the value is the rcl function that sets it."""

    SUBSCRIPTION = "rcl_subscription_set_on_new_message_callback"
    SERVICE = "rcl_service_set_on_new_request_callback"
    CLIENT = "rcl_client_set_on_new_response_callback"
    EVENT = "rcl_event_set_callback"
    TIMER_RESET = "rcl_timer_set_on_reset_callback"


class _TimerSpec(ctypes.Structure):
    """`struct itimerspec`: seconds and nanoseconds of the period, then of the first expiry."""

    _fields_ = (
        ("period_s", ctypes.c_long),
        ("period_ns", ctypes.c_long),
        ("first_s", ctypes.c_long),
        ("first_ns", ctypes.c_long),
    )


# rclpy has already loaded the library; the loader finds the same one by name.
_RCL = ctypes.CDLL("librcl.so")
_LIBC = ctypes.CDLL(None, use_errno=True)
_EVENTFD_WRITE = ctypes.cast(_LIBC.eventfd_write, ctypes.c_void_p)
_SETTERS = {kind: getattr(_RCL, kind.value) for kind in EntityKind}
for _setter in _SETTERS.values():
    _setter.argtypes = (ctypes.c_void_p,) * 3
    _setter.restype = ctypes.c_int
_ABSOLUTE = 1
_S_IN_NS = 10**9


def open_eventfd() -> int:
    """Open a new eventfd; the caller closes it."""
    return os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)


def set_listener(kind: EntityKind, pointer: int, signal_fd: int) -> None:
    """Make the middleware write to `signal_fd` when the entity has data.

    Args:
        kind: the kind of entity.
        pointer: the entity's rcl structure.
        signal_fd: an eventfd; must stay open until `clear_listener`.

    Raises:
        RuntimeError: the middleware does not support listeners.
    """
    code = _SETTERS[kind](pointer, _EVENTFD_WRITE, signal_fd)
    if code != 0:
        raise RuntimeError(
            f"{kind.value} returned {code}: the middleware does not signal new data, which "
            "EventLoopExecutor requires; use rmw_fastrtps_cpp or another executor"
        )


def clear_listener(kind: EntityKind, pointer: int) -> None:
    """Remove the listener; after this call, nothing writes to the eventfd any more."""
    _SETTERS[kind](pointer, None, None)


def open_timer(clock_id: int) -> int:
    """Open a new, unarmed timerfd; the caller closes it.

    Args:
        clock_id: `time.CLOCK_MONOTONIC` or `time.CLOCK_REALTIME`.

    Raises:
        OSError: the kernel reports an error.
    """
    timer_fd = int(_LIBC.timerfd_create(clock_id, os.O_NONBLOCK | os.O_CLOEXEC))
    if timer_fd < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return timer_fd


def arm_timer(timer_fd: int, first_ns: int, period_ns: int) -> None:
    """Make a timerfd expire at `first_ns` on its clock [ns], then every `period_ns` [ns].

    If `first_ns` is 0, it never expires. If `period_ns` is 0, it expires once.
    """
    spec = _TimerSpec(*divmod(period_ns, _S_IN_NS), *divmod(first_ns, _S_IN_NS))
    _LIBC.timerfd_settime(timer_fd, _ABSOLUTE, ctypes.byref(spec), None)
