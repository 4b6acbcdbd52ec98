"""Run a case once: start its processes, measure them from outside, and stop them."""

import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

from benchmarks.loop.cases import FLOOR, Case
from benchmarks.loop.figures import Figures, Usage, figures_of
from benchmarks.loop.record import read_records
from benchmarks.loop.turns import Failed
from obelisk_spec.runtime_protocol import LOCAL_TRANSPORT_VARIABLE
from obk_cli.process.shared_memory import remove_dead_segments

__all__ = ["measure"]

ROOT = Path(__file__).resolve().parents[2]
READY_S = 120.0
"""Time by which every node must receive its first message [s]."""
SETTLE_S = 1.0
"""Wait after that, until discovery is complete and caches are warm [s]."""
END_S = 10.0
"""Time by which a process must write its record and exit [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Worker:
    """A process that runs nodes."""

    process: "subprocess.Popen[bytes]"
    record: Path
    log: Path


@dataclass(frozen=True, slots=True, kw_only=True)
class _Moment:
    """CPU time used so far [s]."""

    at_ns: int
    own_s: float
    machine_s: float
    stolen_s: float
    """Time that the host stole from the machine."""


class _FailedError(Exception):
    """The reason for a `Failed`."""


def measure(case: Case, *, seconds: float, floor: Path, folder: Path) -> Figures | Failed:
    """Run a case and measure it for some time.

    Args:
        case: the case to run.
        seconds: the duration of the measurement, after all nodes have received messages.
        floor: the compiled C program.
        folder: an empty folder for the files of the processes.
    """
    try:
        with _workers(case, floor, folder) as workers:
            _await_ready(workers)
            time.sleep(SETTLE_S)
            start = _moment(workers)
            time.sleep(seconds)
            end = _moment(workers)
            _end(workers)
        records = [record for worker in workers for record in read_records(worker.record)]
        return figures_of(records, _usage(start, end), start.at_ns, end.at_ns)
    except (_FailedError, ValueError) as failure:
        return Failed(why=str(failure))
    finally:
        remove_dead_segments()  # left by killed processes


@contextmanager
def _workers(case: Case, floor: Path, folder: Path) -> Iterator[Sequence[_Worker]]:
    """Start the processes of a case; kill those that are left on exit."""
    workers: list[_Worker] = []
    sockets = folder / "sockets"
    sockets.mkdir(mode=0o700)
    try:
        for names in case.processes:
            workers.append(_start(case, names, floor, folder, sockets))
        yield workers
    finally:
        for worker in workers:
            worker.process.kill()
        for worker in workers:
            worker.process.communicate()


def _start(case: Case, names: Sequence[str], floor: Path, folder: Path, sockets: Path) -> _Worker:
    record, log = folder / f"{names[0]}.json", folder / f"{names[0]}.log"
    if case.contestant == FLOOR:
        program = [str(floor)]
    else:
        program = [sys.executable, "-m", "benchmarks.loop.worker", case.contestant]
    with log.open("wb") as errors:
        process = subprocess.Popen(
            [*program, str(case.rate_hz), str(case.joints), str(record), *names],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            bufsize=0,
            cwd=ROOT,
            env={LOCAL_TRANSPORT_VARIABLE: str(sockets), **os.environ},
        )
    return _Worker(process=process, record=record, log=log)


def _await_ready(workers: Sequence[_Worker]) -> None:
    end_s = time.monotonic() + READY_S
    for worker in workers:
        output = worker.process.stdout
        assert output is not None
        left_s = max(0.0, end_s - time.monotonic())
        if not select.select([output], [], [], left_s)[0]:
            raise _FailedError(f"not all nodes received a message within {READY_S:g} s")
        # `ready`, or the end of file if the process has died.
        if not output.readline():
            raise _FailedError(f"a process died: {_last_line(worker.log)}")


def _end(workers: Sequence[_Worker]) -> None:
    """Stop all at once. A process that hangs after it has written its record is killed later."""
    for worker in workers:
        assert worker.process.stdin is not None
        worker.process.stdin.close()
        worker.process.stdin = None
    end_s = time.monotonic() + END_S
    for worker in workers:
        with suppress(subprocess.TimeoutExpired):
            worker.process.wait(max(0.0, end_s - time.monotonic()))
    for worker in workers:
        if not worker.record.exists():
            raise _FailedError(f"a process left no record: {_last_line(worker.log)}")


def _moment(workers: Sequence[_Worker]) -> _Moment:
    try:
        own_s = sum(_used_s(worker.process.pid) for worker in workers)
    except OSError:
        raise _FailedError("a process died while it was measured") from None
    machine = psutil.cpu_times()
    idle_s = machine.idle + machine.iowait
    twice_s = machine.guest + machine.guest_nice  # included in `user` and `nice`
    return _Moment(
        at_ns=time.monotonic_ns(),
        own_s=own_s,
        machine_s=sum(machine) - idle_s - twice_s - machine.steal,
        stolen_s=machine.steal,
    )


def _used_s(pid: int) -> float:
    """CPU time of all threads of a process so far; /proc has it in steps of 10 ms only.

    Source: clock_getcpuclockid(3); the kernel's include/linux/posix-timers_types.h shows how a
    clock ID is computed from a pid (`MAKE_PROCESS_CPUCLOCK`, `CPUCLOCK_SCHED`).
    """
    return time.clock_gettime(~pid << 3 | 2)


def _usage(start: _Moment, end: _Moment) -> Usage:
    seconds = (end.at_ns - start.at_ns) / 1e9
    own = 100 * (end.own_s - start.own_s) / seconds
    machine = 100 * (end.machine_s - start.machine_s) / seconds
    stolen = 100 * (end.stolen_s - start.stolen_s) / seconds
    return Usage(own=own, others=max(0.0, machine - own), stolen=stolen)


def _last_line(log: Path) -> str:
    lines = log.read_text(encoding="utf-8", errors="replace").split("\n")
    return next((line for line in reversed(lines) if line.strip()), "no output")
