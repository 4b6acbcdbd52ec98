"""The `shared-memory`, `transport`, `folders`, `realtime` and `cpu` checks of the machine."""

import getpass
import os
import resource
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from obelisk_spec.local_transport.sockets import SocketFolder
from obelisk_spec.runtime_protocol import LOCAL_TRANSPORT_OFF, LOCAL_TRANSPORT_VARIABLE
from obk_cli.doctor.finding import GIB, MIB, Fact, Finding, bytes_text, note, ok, warning
from obk_cli.files import explain_os_error
from obk_cli.process.shared_memory import SHARED_MEMORY
from obk_cli.runs.folder import runs_folder
from obk_cli.workspace.model_reader import cache_folder

__all__ = [
    "CpuFacts",
    "FolderFacts",
    "RealtimeFacts",
    "SharedMemoryFacts",
    "TransportFacts",
    "judge_cpu",
    "judge_folders",
    "judge_realtime",
    "judge_shared_memory",
    "judge_transport",
    "probe_cpu",
    "probe_folders",
    "probe_realtime",
    "probe_shared_memory",
    "probe_transport",
]

LEAST_SHARED_BYTES: Final = 64 * MIB
"""A node needs about half a MiB, camera images much more."""
MANY_FILES: Final = 500
GROW: Final = (
    "sudo mount -o remount,size=512M /dev/shm    # a container: docker run --shm-size=512m"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedMemoryFacts:
    """The /dev/shm folder."""

    total_bytes: int | None
    """None: the folder does not exist."""
    free_bytes: int
    fault: str
    """Why no file can be created there; empty if one can."""
    dds_files: int
    """Number of Fast DDS files in it, of all users."""


def judge_shared_memory(facts: SharedMemoryFacts) -> Iterator[Finding]:
    """Report whether processes can exchange messages through it."""
    if facts.total_bytes is None:
        yield warning(
            "no folder /dev/shm: messages use the slower network stack",
            "sudo mount -t tmpfs -o size=512M tmpfs /dev/shm",
        )
        return
    room = f"/dev/shm has {bytes_text(facts.free_bytes)} of {bytes_text(facts.total_bytes)} free"  # noqa: S108
    sizes: dict[str, Fact] = {"total_bytes": facts.total_bytes, "free_bytes": facts.free_bytes}
    if facts.fault:
        yield warning(
            f"cannot write to /dev/shm: {facts.fault}; DDS uses a slower transport",
            "sudo mount -o remount,rw /dev/shm && sudo chmod 1777 /dev/shm",
            **sizes,
        )
    elif facts.free_bytes < LEAST_SHARED_BYTES:
        fix = GROW if facts.total_bytes < 2 * LEAST_SHARED_BYTES else "obk reap"
        yield warning(f"{room}; DDS needs at least {bytes_text(LEAST_SHARED_BYTES)}", fix, **sizes)
    else:
        yield ok(room, **sizes)
    if facts.dds_files > MANY_FILES:
        yield note(
            f"{facts.dds_files} Fast DDS files are in /dev/shm, most of them left by killed nodes",
            "obk reap",
            dds_files=facts.dds_files,
        )


def probe_shared_memory(folder: Path = SHARED_MEMORY) -> SharedMemoryFacts:
    """Measure the free space in /dev/shm."""
    if not folder.is_dir():
        return SharedMemoryFacts(total_bytes=None, free_bytes=0, fault="", dds_files=0)
    space = os.statvfs(folder)
    return SharedMemoryFacts(
        total_bytes=space.f_frsize * space.f_blocks,
        free_bytes=space.f_frsize * space.f_bavail,
        fault=_write_fault(folder),
        dds_files=sum(1 for _ in folder.glob("fastrtps_*")),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class TransportFacts:
    """The local transport between the nodes of a run."""

    is_on: bool
    """Whether the user has left it on."""
    folder: str
    """The folder of runs, which contains their sockets."""
    fault: str
    """Why a publisher cannot reach a subscription there; empty if it can."""


def judge_transport(facts: TransportFacts) -> Iterator[Finding]:
    """Report whether the nodes of a run exchange messages without DDS."""
    if not facts.is_on:
        yield ok(
            f"messages between processes use DDS ({LOCAL_TRANSPORT_VARIABLE}={LOCAL_TRANSPORT_OFF})"
        )
    elif facts.fault:
        yield warning(
            f"no sockets in {facts.folder}: {facts.fault}; all messages between processes use DDS",
            "export OBK_HOME=/a/folder/on/a/local/disk",
            folder=facts.folder,
        )
    else:
        yield ok("processes of a run exchange messages through local sockets", folder=facts.folder)


def probe_transport(environment: Mapping[str, str]) -> TransportFacts:
    """Connect two sockets in the same way as a publisher and a subscription of a run.

    Raises:
        CommandFailedError: no folder for runs is available.
    """
    runs = runs_folder(environment)
    place = next(folder for folder in (runs, *runs.parents) if folder.is_dir())
    return TransportFacts(
        is_on=environment.get(LOCAL_TRANSPORT_VARIABLE) != LOCAL_TRANSPORT_OFF,
        folder=str(runs),
        fault=_socket_fault(place),
    )


def _socket_fault(place: Path) -> str:
    gid, depth = bytes(16), 1
    try:
        with tempfile.TemporaryDirectory(dir=place, prefix=".obk-doctor-") as path:
            sockets = SocketFolder(path)
            with sockets.listen(gid, depth):
                connection = sockets.connect(gid, depth)
    except OSError as fault:
        return explain_os_error(fault)
    if connection is None:
        return "the connection was refused"
    connection.close()
    return ""


ENOUGH_FREE_BYTES: Final = GIB
LEAST_FREE_BYTES: Final = 100 * MIB


@dataclass(frozen=True, slots=True, kw_only=True)
class FolderFacts:
    """One folder that obk writes to."""

    purpose: str
    """The contents of the folder."""
    folder: str | None
    """None: no folder is available to the user."""
    fault: str
    """Why nothing can be written there; empty if it can."""
    free_bytes: int
    mover: str
    """The variable that moves the folder elsewhere."""


def judge_folders(folders: tuple[FolderFacts, ...]) -> Iterator[Finding]:
    """Report each folder that obk writes to."""
    for facts in folders:
        move = f"export {facts.mover}=/a/folder/with/room"
        measured: dict[str, Fact] = {"folder": facts.folder, "free_bytes": facts.free_bytes}
        if facts.folder is None:
            yield warning(f"no folder is available for {facts.purpose}", move)
        elif facts.fault:
            yield warning(f"{facts.purpose}: {facts.folder}: {facts.fault}", move, **measured)
        elif facts.free_bytes < ENOUGH_FREE_BYTES:
            much = "almost full" if facts.free_bytes < LEAST_FREE_BYTES else "filling up"
            yield warning(
                f"{facts.purpose}: the disk of {facts.folder} is {much}, "
                f"{bytes_text(facts.free_bytes)} free",
                f"du -sh {facts.folder}    # or: {move}",
                **measured,
            )
        else:
            yield ok(
                f"{facts.purpose}: {facts.folder}, {bytes_text(facts.free_bytes)} free", **measured
            )


def probe_folders(environment: Mapping[str, str]) -> tuple[FolderFacts, ...]:
    """Measure each folder, or its nearest existing parent."""
    return (
        _folder_facts("runs and their logs", runs_folder(environment), "OBK_HOME"),
        _folder_facts("the model cache", cache_folder(environment), "XDG_CACHE_HOME"),
        _folder_facts("temporary files", Path(tempfile.gettempdir()), "TMPDIR"),
    )


def _folder_facts(purpose: str, folder: Path | None, mover: str) -> FolderFacts:
    if folder is None:
        return FolderFacts(purpose=purpose, folder=None, fault="", free_bytes=0, mover=mover)
    existing = next(path for path in (folder, *folder.parents) if path.exists())
    is_folder = existing.is_dir()
    space = os.statvfs(existing)
    return FolderFacts(
        purpose=purpose,
        folder=str(folder),
        fault=_write_fault(existing) if is_folder else f"{existing} is a file",
        free_bytes=space.f_frsize * space.f_bavail,
        mover=mover,
    )


def _write_fault(folder: Path) -> str:
    """Why no file can be written into a folder; empty if it can. The test file is removed."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"obk doctor")
            file.flush()
    except OSError as fault:
        return fault.strerror or str(fault)
    return ""


LEAST_LOCKED_BYTES: Final = 256 * MIB
QUICK_CLOCKS: Final = ("tsc", "kvm-clock", "arch_sys_counter")
SLOW_READ_NS: Final = 500
FEWEST_CPUS: Final = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class RealtimeFacts:
    """The kernel's limits for this user."""

    highest_priority: int
    """RLIMIT_RTPRIO; -1 for unlimited."""
    got_priority: bool
    """Whether a thread actually got the lowest real-time priority."""
    locked_bytes: int
    """RLIMIT_MEMLOCK; -1 for unlimited."""
    user: str


def judge_realtime(facts: RealtimeFacts) -> Iterator[Finding]:
    """Report whether control loops can take priority over other programs."""
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
    """Processors that this process may use."""
    quota: float | None
    """A container's limit on processors in use; None if there is none."""
    load: float
    """Average number of processes that wanted to run in the last minute."""
    governors: Mapping[str, int]
    """Frequency governor -> number of processors that use it; empty if the kernel reports none."""
    clock: str
    """The kernel's clock source; empty if it reports none."""
    clock_read_ns: float
    """Duration of reading the clock [ns]."""


def judge_cpu(facts: CpuFacts) -> Iterator[Finding]:
    """Report whether control loops can be on time."""
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
            f"load average {facts.load:.1f} on {processors}: control loops will miss deadlines",
            "top",
            **measured,
        )
    else:
        yield ok(f"{processors}, load average {facts.load:.1f}", **measured)
    yield from _judge_governors(facts)
    yield from _judge_clock(facts)


def _judge_governors(facts: CpuFacts) -> Iterator[Finding]:
    saving = {name: n for name, n in facts.governors.items() if name != "performance"}
    if saving:
        listed = ", ".join(f"{name} on {count}" for name, count in saving.items())
        yield note(
            f"the frequency governor slows processors down between ticks ({listed})",
            "sudo cpupower frequency-set -g performance",
            governors=tuple(facts.governors),
        )


def _judge_clock(facts: CpuFacts) -> Iterator[Finding]:
    is_quick = facts.clock in QUICK_CLOCKS or not facts.clock
    measured: dict[str, Fact] = {"clock": facts.clock, "read_ns": round(facts.clock_read_ns)}
    if is_quick and facts.clock_read_ns < SLOW_READ_NS:
        name = f"clock {facts.clock}" if facts.clock else "the clock"
        yield ok(f"{name} takes {facts.clock_read_ns:.0f} ns to read", **measured)
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
    """Find the kernel's limits for this user; call it in a thread that is not needed afterwards."""
    return RealtimeFacts(
        highest_priority=resource.getrlimit(resource.RLIMIT_RTPRIO)[0],
        got_priority=_got_priority(),
        locked_bytes=resource.getrlimit(resource.RLIMIT_MEMLOCK)[0],
        user=getpass.getuser(),
    )


def _got_priority() -> bool:
    """Whether this thread gets a real-time priority, which is reset afterwards."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(LOWEST_PRIORITY))
    except PermissionError:
        return False
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return True


def probe_cpu(system: Path = SYSTEM, quota: Path = QUOTA) -> CpuFacts:
    """Read processors and clock from files of the kernel."""
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
    start = time.perf_counter_ns()
    for _ in range(READS):
        time.monotonic()
    return (time.perf_counter_ns() - start) / READS


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""
