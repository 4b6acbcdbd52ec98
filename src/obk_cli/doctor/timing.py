"""Checks `realtime` and `cpu`: priority, locked memory, processors and clock for control loops."""

import getpass
import os
import resource
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from obk_cli.doctor.finding import MIB, Fact, Finding, bytes_text, note, ok, warning

__all__ = [
    "CpuFacts",
    "RealtimeFacts",
    "judge_cpu",
    "judge_realtime",
    "probe_cpu",
    "probe_realtime",
]


LEAST_LOCKED_BYTES: Final = 256 * MIB
QUICK_CLOCKS: Final = ("tsc", "kvm-clock", "arch_sys_counter")
SLOW_READ_NS: Final = 500
FEWEST_CPUS: Final = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class RealtimeFacts:
    """What the kernel grants this user."""

    highest_priority: int
    """RLIMIT_RTPRIO; -1 for unlimited."""
    got_priority: bool
    """Whether a thread really got the lowest real-time priority."""
    locked_bytes: int
    """RLIMIT_MEMLOCK; -1 for unlimited."""
    user: str


def judge_realtime(facts: RealtimeFacts) -> Iterator[Finding]:
    """Whether loops can come before everything else that runs."""
    limits: dict[str, Fact] = {
        "rtprio": facts.highest_priority,
        "memlock_bytes": facts.locked_bytes,
    }
    if facts.got_priority:
        yield ok("real-time priority is available", **limits)
    else:
        yield note(
            f"no real-time priority for {facts.user} (RLIMIT_RTPRIO={facts.highest_priority}): "
            "other programs may delay control loops",
            _limit(facts.user, "rtprio", "98"),
            **limits,
        )
    if 0 <= facts.locked_bytes < LEAST_LOCKED_BYTES:
        yield note(
            f"only {bytes_text(facts.locked_bytes)} of memory can be locked (RLIMIT_MEMLOCK): "
            "loops may wait for page faults",
            _limit(facts.user, "memlock", "unlimited"),
            **limits,
        )


def _limit(user: str, item: str, value: str) -> str:
    line = f"{user} - {item} {value}"
    return f"echo '{line}' | sudo tee -a /etc/security/limits.d/obelisk.conf    # then log in again"


@dataclass(frozen=True, slots=True, kw_only=True)
class CpuFacts:
    """The processors and the clock."""

    usable: int
    """Processors that this process may run on."""
    quota: float | None
    """How many a container allows at once, None for no such limit."""
    load: float
    """Processes that wanted to run in the last minute, on average."""
    governors: Mapping[str, int]
    """Frequency governor -> how many processors have it; empty where the kernel tells none."""
    clock: str
    """The kernel's clock source, empty where it tells none."""
    clock_read_ns: float
    """What reading the clock takes [ns]."""


def judge_cpu(facts: CpuFacts) -> Iterator[Finding]:
    """Whether loops are on time."""
    count = facts.usable if facts.quota is None else min(facts.usable, facts.quota)
    processors = f"{count:g} processor{'' if count == 1 else 's'}"
    measured: dict[str, Fact] = {"usable": facts.usable, "quota": facts.quota, "load": facts.load}
    if count < FEWEST_CPUS:
        yield warning(
            f"{processors}: a simulated stack at 1 kHz needs at least {FEWEST_CPUS}",
            "docker run --cpus=2 ...    # or a machine with more",
            **measured,
        )
    elif facts.load > count:
        yield note(
            f"{processors} with a load of {facts.load:.1f}: loops will be late",
            "top",
            **measured,
        )
    else:
        yield ok(f"{processors}, load {facts.load:.1f}", **measured)
    yield from _judge_governors(facts)
    yield from _judge_clock(facts)


def _judge_governors(facts: CpuFacts) -> Iterator[Finding]:
    saving = {name: n for name, n in facts.governors.items() if name != "performance"}
    if saving:
        listed = ", ".join(f"{name} on {count}" for name, count in saving.items())
        yield note(
            f"processors slow down between ticks (frequency governor {listed})",
            "sudo cpupower frequency-set -g performance",
            governors=tuple(facts.governors),
        )


def _judge_clock(facts: CpuFacts) -> Iterator[Finding]:
    is_quick = facts.clock in QUICK_CLOCKS or not facts.clock
    measured: dict[str, Fact] = {"clock": facts.clock, "read_ns": round(facts.clock_read_ns)}
    if is_quick and facts.clock_read_ns < SLOW_READ_NS:
        name = f"clock {facts.clock}" if facts.clock else "the clock"
        yield ok(f"{name} is read in {facts.clock_read_ns:.0f} ns", **measured)
        return
    yield note(
        f"the clock {facts.clock} takes {facts.clock_read_ns:.0f} ns to read; loops read it often",
        "cat /sys/devices/system/clocksource/clocksource0/available_clocksource",
        **measured,
    )


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


def _quota(text: str) -> float | None:
    """`200000 100000` -> 2.0; `max 100000` -> None. Source: Linux, cgroup-v2.rst, cpu.max."""
    allowed, _, period = text.partition(" ")
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
