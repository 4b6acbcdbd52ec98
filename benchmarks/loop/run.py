"""One run of one case: starts its processes, measures them from outside, ends them all."""

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
"""Within which every node has to hear its first message [s]."""
SETTLE_S = 1.0
"""From then on, for discovery and caches to come to rest [s]."""
END_S = 10.0
"""Within which a process has to write its record and to end [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Worker:
    """A process of nodes."""

    process: "subprocess.Popen[bytes]"
    record: Path
    log: Path


@dataclass(frozen=True, slots=True, kw_only=True)
class _Moment:
    """Processor time used so far [s]."""

    at_ns: int
    own_s: float
    machine_s: float
    stolen_s: float
    """Wanted by the machine, and not given by its host."""


class _FailedError(Exception):
    """The sentence of a `Failed`."""


def measure(case: Case, *, seconds: float, floor: Path, folder: Path) -> Figures | Failed:
    """Run a case and measure it for some time.

    Args:
        case: what runs.
        seconds: how long is measured, once all nodes hear one another.
        floor: the compiled C program.
        folder: for the files of the processes; empty.
    """
    try:
        with _workers(case, floor, folder) as workers:
            _await_ready(workers)
            time.sleep(SETTLE_S)
            begin = _moment(workers)
            time.sleep(seconds)
            end = _moment(workers)
            _end(workers)
        records = [record for worker in workers for record in read_records(worker.record)]
        return figures_of(records, _usage(begin, end), begin.at_ns, end.at_ns)
    except (_FailedError, ValueError) as failure:
        return Failed(why=str(failure))
    finally:
        remove_dead_segments()  # of processes that had to be killed


@contextmanager
def _workers(case: Case, floor: Path, folder: Path) -> Iterator[Sequence[_Worker]]:
    """The processes of a case; killed at the latest when left."""
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
            raise _FailedError(f"after {READY_S:g} s not all nodes heard one another")
        # Its one line, or the end of a process that has died.
        if not output.readline():
            raise _FailedError(f"a process died: {_last_line(worker.log)}")


def _end(workers: Sequence[_Worker]) -> None:
    """End all at once. Who has written its record and hangs then is killed later."""
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
    twice_s = machine.guest + machine.guest_nice  # in `user` and `nice` too
    return _Moment(
        at_ns=time.monotonic_ns(),
        own_s=own_s,
        machine_s=sum(machine) - idle_s - twice_s - machine.steal,
        stolen_s=machine.steal,
    )


def _used_s(pid: int) -> float:
    """Of a process so far, all its threads; /proc has it in steps of 10 ms only.

    Source: clock_getcpuclockid(3); how a clock's number is made of a pid stands in the kernel's
    include/linux/posix-timers_types.h (`MAKE_PROCESS_CPUCLOCK`, `CPUCLOCK_SCHED`).
    """
    return time.clock_gettime(~pid << 3 | 2)


def _usage(begin: _Moment, end: _Moment) -> Usage:
    seconds = (end.at_ns - begin.at_ns) / 1e9
    own = 100 * (end.own_s - begin.own_s) / seconds
    machine = 100 * (end.machine_s - begin.machine_s) / seconds
    stolen = 100 * (end.stolen_s - begin.stolen_s) / seconds
    return Usage(own=own, others=max(0.0, machine - own), stolen=stolen)


def _last_line(log: Path) -> str:
    lines = log.read_text(encoding="utf-8", errors="replace").split("\n")
    return next((line for line in reversed(lines) if line.strip()), "it said nothing")
