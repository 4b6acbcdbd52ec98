"""Ask the kernel for short time slices, so that a thread runs soon after it wakes up.

Linux lets a running thread finish its slice, about 1 to 3 ms, before it gives the core to another
one with the same priority. A thread with a shorter slice need not wait for that. It does not get
more of the core, only smaller parts, so this requires no privileges. Kernels before 6.12 ignore it.

Source: sched_setattr(2); `Documentation/scheduler/sched-eevdf.rst` and `kernel/sched/syscalls.c` of
Linux 6.12.
"""

import ctypes
import os
import platform
from typing import Final

__all__ = ["TIME_SLICE_NS", "reset_time_slice", "shorten_time_slice", "time_slice_ns"]

TIME_SLICE_NS: Final = 100_000
"""The shortest slice that the kernel grants [ns]."""
_CALLING_THREAD: Final = 0
_DEFAULT_SLICE: Final = 0
_SET_CALLS: Final = {"x86_64": 314, "aarch64": 274}
"""The number of the system call `sched_setattr`; `sched_getattr` has the next one."""


class _Attributes(ctypes.Structure):
    """`struct sched_attr`, first version."""

    _fields_ = (
        ("size", ctypes.c_uint32),
        ("policy", ctypes.c_uint32),
        ("flags", ctypes.c_uint64),
        ("nice", ctypes.c_int32),
        ("priority", ctypes.c_uint32),
        ("runtime_ns", ctypes.c_uint64),
        ("deadline_ns", ctypes.c_uint64),
        ("period_ns", ctypes.c_uint64),
    )


def time_slice_ns(thread: int = _CALLING_THREAD) -> int:
    """The time slice of a thread [ns]; 0 if the kernel does not report it.

    Args:
        thread: the id of a thread, or of a process for its main thread.
    """
    attributes = _read(thread)
    return 0 if attributes is None else int(attributes.runtime_ns)


def shorten_time_slice() -> None:
    """Shorten the slices of the calling thread and of all threads and processes it will create.

    Has no effect if their policy is not `SCHED_OTHER`, or if the system forbids it.
    """
    _request(_CALLING_THREAD, TIME_SLICE_NS)


def reset_time_slice(thread: int = _CALLING_THREAD) -> None:
    """Give a thread the system's default slice again, and with it all threads it will create.

    Args:
        thread: as for `time_slice_ns`.
    """
    _request(thread, _DEFAULT_SLICE)


def _request(thread: int, slice_ns: int) -> None:
    attributes = _read(thread)
    if attributes is not None and attributes.policy == os.SCHED_OTHER:
        attributes.runtime_ns = slice_ns
        _call(0, thread, ctypes.byref(attributes), 0)


def _read(thread: int) -> _Attributes | None:
    size = ctypes.sizeof(_Attributes)
    attributes = _Attributes(size=size)
    return attributes if _call(1, thread, ctypes.byref(attributes), size, 0) else None


def _call(offset: int, *arguments: object) -> bool:
    """Make the system call `sched_setattr` (0) or `sched_getattr` (1); false if it fails."""
    number = _SET_CALLS.get(platform.machine())
    return number is not None and ctypes.CDLL(None).syscall(number + offset, *arguments) == 0
