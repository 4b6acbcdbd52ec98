"""Limits, processors and clock, asked of the kernel; a real-time priority is really asked for."""

import getpass
import os
import resource
import time
from collections import Counter
from pathlib import Path
from typing import Final

from obk_cli.doctor.timing import CpuFacts, RealtimeFacts

__all__ = ["probe_cpu", "probe_realtime"]

SYSTEM: Final = Path("/sys/devices/system")
QUOTA: Final = Path("/sys/fs/cgroup/cpu.max")
READS: Final = 2000
LOWEST_PRIORITY: Final = 1


def probe_realtime() -> RealtimeFacts:
    """What the kernel grants this user; to be called in a thread that nothing else needs."""
    return RealtimeFacts(
        highest_priority=resource.getrlimit(resource.RLIMIT_RTPRIO)[0],
        got_priority=_got_priority(),
        locked_bytes=resource.getrlimit(resource.RLIMIT_MEMLOCK)[0],
        user=getpass.getuser(),
    )


def _got_priority() -> bool:
    """Whether this thread gets a real-time priority; afterwards it is as it was."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(LOWEST_PRIORITY))
    except PermissionError:
        return False
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return True


def probe_cpu(system: Path = SYSTEM, quota: Path = QUOTA) -> CpuFacts:
    """Processors and clock, from files of the kernel."""
    governors = Counter(map(_text, system.glob("cpu/cpu*/cpufreq/scaling_governor")))
    return CpuFacts(
        usable=len(os.sched_getaffinity(0)),
        quota=_quota(_text(quota)),
        load=os.getloadavg()[0],
        governors=dict(governors),
        clock=_text(system / "clocksource/clocksource0/current_clocksource"),
        clock_read_ns=_clock_read_ns(),
    )


def _quota(told: str) -> float | None:
    """`200000 100000` -> 2.0; `max 100000` -> None. Source: Linux, cgroup-v2.rst, cpu.max."""
    allowed, _, period = told.partition(" ")
    return int(allowed) / int(period) if allowed.isdecimal() and period.isdecimal() else None


def _clock_read_ns() -> float:
    begin = time.perf_counter_ns()
    for _ in range(READS):
        time.monotonic()
    return (time.perf_counter_ns() - begin) / READS


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""
