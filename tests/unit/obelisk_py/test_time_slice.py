"""Short time slices of threads and of the processes that they start."""

import os
import platform
import subprocess
import sys
import threading

from obelisk_py.core.time_slice import TIME_SLICE_NS, shorten_time_slice, time_slice_ns

CHILD = "from obelisk_py.core.time_slice import time_slice_ns; print(time_slice_ns())"


def granted_ns(before_ns: int) -> int:
    """The slice after a request; kernels before 6.12 ignore it."""
    major, minor = (int(number) for number in platform.release().split(".")[:2])
    return TIME_SLICE_NS if (major, minor) >= (6, 12) else before_ns


def test_a_short_slice_is_inherited_by_threads_and_processes() -> None:
    before_ns = time_slice_ns()
    found = []

    def shorten() -> None:
        shorten_time_slice()
        inner = threading.Thread(target=lambda: found.append(time_slice_ns()))
        inner.start()
        inner.join()
        found.append(time_slice_ns())
        command = [sys.executable, "-c", CHILD]
        found.append(int(subprocess.run(command, capture_output=True, check=True).stdout))

    thread = threading.Thread(target=shorten)
    thread.start()
    thread.join()
    assert found == [granted_ns(before_ns)] * 3
    assert time_slice_ns() == before_ns


def test_another_policy_is_kept() -> None:
    policies = []

    def shorten() -> None:
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
        before_ns = time_slice_ns()
        shorten_time_slice()
        policies.append((os.sched_getscheduler(0), time_slice_ns() == before_ns))

    thread = threading.Thread(target=shorten)
    thread.start()
    thread.join()
    assert policies == [(os.SCHED_BATCH, True)]


def test_niceness_is_kept() -> None:
    found = []

    def shorten() -> None:
        thread_id = threading.get_native_id()
        os.setpriority(os.PRIO_PROCESS, thread_id, 3)
        shorten_time_slice()
        found.append(os.getpriority(os.PRIO_PROCESS, thread_id))

    thread = threading.Thread(target=shorten)
    thread.start()
    thread.join()
    assert found == [3]
