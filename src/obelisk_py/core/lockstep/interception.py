"""Simulated time, chance and logs for code that asks the system: `time`, `datetime`, `os.urandom`.

While installed, these functions answer by the run in progress, but only inside callbacks and guest
threads of its nodes: the test runner, DDS and all other threads see the system's time as ever. The
modules are changed in place, so a module with `from time import monotonic` has to be imported
after the installation.
"""

import datetime
import os
import random
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any, Final

from rclpy.clock import Clock
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.time import Time

from obelisk_py.core.lockstep.guest_thread import GuestThread
from obelisk_py.core.lockstep.scheduler import NS_PER_S, Scheduler

__all__ = ["Interception", "LogEntry", "intercepted", "run_in_progress"]

_IN_SECONDS: Final = ("time", "monotonic", "perf_counter")
_IN_NANOSECONDS: Final = ("time_ns", "monotonic_ns", "perf_counter_ns")


@dataclass(frozen=True, slots=True, kw_only=True)
class LogEntry:
    """What a node logged."""

    time_ns: int
    """Simulated time [ns]."""
    severity: int
    """10 debug, 20 info, 30 warning, 40 error, 50 fatal, as in rcutils."""
    name: str
    """Of the logger."""
    text: str
    place: str
    """`file:line` of the call."""


@dataclass(slots=True, kw_only=True)
class Interception:
    """What intercepted calls answer by: one run."""

    scheduler: Scheduler
    entropy: random.Random
    """In place of the system's randomness, so that unseeded generators repeat too."""
    log: list[LogEntry] = field(default_factory=list)

    def is_inside(self) -> bool:
        """Whether the caller is a callback or a guest thread of the run."""
        if self.scheduler.running is None:
            return False
        if threading.get_ident() == self.scheduler.thread_id:
            return True
        return isinstance(threading.current_thread(), GuestThread)


class _RunInProgress:
    """The run in progress of this process; the patched functions look here."""

    def __init__(self) -> None:
        self.interception: Interception | None = None

    def inside(self) -> Interception | None:
        """The run, if the caller is a callback of it."""
        run = self.interception
        return run if run is not None and run.is_inside() else None


_process: Final = _RunInProgress()
"""One for the process, as the modules `time` and `os` are."""


@contextmanager
def run_in_progress(interception: Interception) -> Iterator[None]:
    """While entered, intercepted calls answer by this run."""
    before, _process.interception = _process.interception, interception
    try:
        yield
    finally:
        _process.interception = before


@contextmanager
def intercepted() -> Iterator[None]:
    """While entered, the functions of the system are replaced."""
    with ExitStack() as stack:
        for target, name, replacement in _replacements():
            stack.callback(setattr, target, name, getattr(target, name))
            setattr(target, name, replacement)
        yield


def _replacements() -> Iterator[tuple[Any, str, Any]]:
    for name in _IN_SECONDS:
        yield time, name, _simulated(getattr(time, name), in_seconds=True)
    for name in _IN_NANOSECONDS:
        yield time, name, _simulated(getattr(time, name), in_seconds=False)
    yield time, "sleep", _sleep_function(time.sleep)
    yield datetime, "datetime", _datetime_class(datetime.datetime)
    yield Clock, "now", _now_of_clocks(Clock.now)
    urandom = _urandom_function(os.urandom)
    yield os, "urandom", urandom
    yield random, "_urandom", urandom
    yield threading.Thread, "start", _start_function(threading.Thread.start)
    log = rclpy_implementation.rclpy_logging_rcutils_log
    yield rclpy_implementation, "rclpy_logging_rcutils_log", _log_function(log)


def _simulated(real: Callable[[], Any], *, in_seconds: bool) -> Callable[[], Any]:
    def call() -> Any:
        run = _process.inside()
        if run is None:
            return real()
        time_ns = run.scheduler.time_ns
        return time_ns / NS_PER_S if in_seconds else time_ns

    return call


def _sleep_function(real: Callable[[float], None]) -> Callable[[float], None]:
    def sleep(seconds: float) -> None:
        run = _process.inside()
        thread = threading.current_thread()
        if run is None:
            real(seconds)
        elif isinstance(thread, GuestThread):
            thread.sleep(seconds)
        else:
            run.scheduler.sleep(seconds, _caller())

    return sleep


def _caller() -> str:
    code = sys._getframe(2)
    return f"{code.f_code.co_filename}:{code.f_lineno}"


def _datetime_class(real: type[datetime.datetime]) -> type[datetime.datetime]:
    class IsDatetime(type):
        """C code makes instances of the real class, which are instances of the replacement too."""

        def __instancecheck__(cls, instance: object) -> bool:
            return isinstance(instance, real)

        def __subclasscheck__(cls, subclass: type) -> bool:
            return issubclass(subclass, real)

    class SimulatedDatetime(real, metaclass=IsDatetime):  # type: ignore[misc, valid-type]
        """`datetime` whose present is the simulated one inside callbacks."""

        @classmethod
        def now(cls, tz: datetime.tzinfo | None = None) -> datetime.datetime:
            run = _process.inside()
            if run is None:
                return real.now(tz)
            return real.fromtimestamp(run.scheduler.time_ns / NS_PER_S, tz)

        @classmethod
        def utcnow(cls) -> datetime.datetime:
            return cls.now(datetime.UTC).replace(tzinfo=None)

        @classmethod
        def today(cls) -> datetime.datetime:
            return cls.now()

    SimulatedDatetime.__name__ = SimulatedDatetime.__qualname__ = real.__name__
    return SimulatedDatetime


def _now_of_clocks(real: Callable[[Any], Time]) -> Callable[[Any], Time]:
    def now(self: Clock) -> Time:
        run = _process.inside()
        if run is None:
            return real(self)
        return Time(nanoseconds=run.scheduler.time_ns, clock_type=self.clock_type)

    return now


def _urandom_function(real: Callable[[int], bytes]) -> Callable[[int], bytes]:
    def urandom(size: int) -> bytes:
        run = _process.inside()
        return real(size) if run is None else run.entropy.randbytes(size)

    return urandom


def _start_function(real: Callable[[threading.Thread], None]) -> Callable[[Any], None]:
    def start(self: threading.Thread) -> None:
        run = _process.inside()
        if run is not None and not isinstance(self, GuestThread) and not _is_of_library(self):
            node = run.scheduler.running
            run.scheduler.note(
                ("thread", self.name),
                f"{node.name if node else 'a callback'} starts the thread `{self.name}`, which is "
                "not in lock-step: what it does may differ from run to run",
            )
        real(self)

    return start


def _is_of_library(thread: threading.Thread) -> bool:
    """Whether a thread belongs to a camera of the simulator, which waits for it."""
    return thread.name.startswith("camera ")


def _log_function(real: Callable[..., None]) -> Callable[..., None]:
    def log(severity: Any, name: str, text: str, function: str, path: str, line: int) -> None:
        run = _process.interception
        if run is None:
            real(severity, name, text, function, path, line)
            return
        run.log.append(
            LogEntry(
                time_ns=run.scheduler.time_ns,
                severity=int(severity),
                name=name,
                text=text,
                place=f"{path}:{line}",
            )
        )

    return log
