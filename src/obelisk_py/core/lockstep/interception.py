"""Replace system time, randomness and logging with those of a lockstep run.

While installed, functions such as `time.time`, `datetime.now` and `os.urandom` return the values of
the run in progress. This applies only inside callbacks and guest threads of its nodes. The test
runner, DDS and all other threads still see the system's values. The modules are patched in place,
so a module with `from time import monotonic` must be imported after the installation. Operations
that cannot be simulated, such as spinning an executor, raise an error.
"""

import copyreg
import datetime
import functools
import os
import queue
import random
import sched
import selectors
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from types import BuiltinFunctionType, FrameType
from typing import Any, Final, cast

from rclpy import utilities
from rclpy.clock import Clock
from rclpy.context import Context
from rclpy.executors import Executor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.time import Time

from obelisk_py.core.lifecycle import GuardedLifecycleNode
from obelisk_py.core.lockstep.guest_thread import (
    Guest,
    GuestThread,
    guest_of,
    take_time,
    wait_in_callback,
)
from obelisk_py.core.lockstep.locks import NodeLock, NodeRLock, lock_class
from obelisk_py.core.lockstep.scheduler import (
    NS_PER_S,
    LockstepError,
    ScheduledNode,
    Scheduler,
    user_place,
)

__all__ = [
    "Interception",
    "LogEntry",
    "intercepted",
    "refuse_plain_nodes",
    "repeatable_import",
    "run_in_progress",
]

_IN_SECONDS: Final = ("time", "monotonic", "perf_counter")
_IN_NANOSECONDS: Final = ("time_ns", "monotonic_ns", "perf_counter_ns")
_OF_A_TIME: Final = ("localtime", "gmtime", "ctime")
"""Functions of `time` that use the current time unless given a time."""
_TIMED: Final = (threading, queue, sched)
"""Modules whose timeouts use functions of `time` that they imported by name."""
_CLOCKS: Final = ("CLOCK_REALTIME", "CLOCK_MONOTONIC", "CLOCK_MONOTONIC_RAW", "CLOCK_BOOTTIME")
"""System clocks that show the time, as opposed to the CPU time of a process or thread."""
_EVENT_LOOPS: Final = ("asyncio.",)
_OF_PROCESSES: Final = ("subprocess.", "multiprocessing.")
"""Modules that wait for other processes, which take real time."""
_OWN_WAITS: Final = ("obelisk_py.",)
_OWN_THREADS: Final = (*_OWN_WAITS, "threading.", "rclpy.", "mujoco.")
"""Modules whose waits and threads do not belong to user code."""
_THREAD_STARTERS: Final = tuple(f"{name}." for name in sys.stdlib_module_names - {"__main__"})
"""Modules whose threads, such as those of a pool, block where they cannot have turns."""
_WITH_REAL_LOCKS: Final = (*_THREAD_STARTERS, *_OWN_THREADS)
_OF_CHANCE: Final = (f"{__name__}.", "random.", "secrets.", "numpy.random.")
"""Modules that request the system's randomness on behalf of their callers."""
_SEED_BITS: Final = 256


@dataclass(frozen=True, slots=True, kw_only=True)
class LogEntry:
    """A log message of a node."""

    time_ns: int
    """Simulated time [ns]."""
    severity: int
    """10 debug, 20 info, 30 warning, 40 error, 50 fatal, as in rcutils."""
    name: str
    """Name of the logger."""
    text: str
    place: str
    """`file:line` of the call."""


@dataclass(slots=True, kw_only=True)
class Interception:
    """The run whose values intercepted calls return."""

    scheduler: Scheduler
    entropy: random.Random
    """Replaces the system's randomness, so that unseeded generators are repeatable too."""
    log: list[LogEntry] = field(default_factory=list)
    guests: list[Guest] = field(default_factory=list)
    """Threads of the nodes."""
    with_threads: set[ScheduledNode] = field(default_factory=set)
    """The nodes with threads outside lockstep."""

    @property
    def has_threads(self) -> bool:
        """Whether the running node has threads outside lockstep."""
        return self.scheduler.running in self.with_threads

    def is_inside(self) -> bool:
        """Whether the caller is a callback or a guest thread of the run."""
        if self.scheduler.running is None:
            return False
        if threading.get_ident() == self.scheduler.thread_id:
            return True
        return guest_of(threading.current_thread()) is not None

    def has_guest(self, thread_id: int | None) -> bool:
        """Whether a thread takes turns with the callbacks."""
        return any(guest.thread_id == thread_id and not guest.has_left for guest in self.guests)

    def wait(self, condition: Callable[[], bool], timeout_s: float | None) -> bool:
        """Wait in a callback for a condition that only threads of its node can change.

        Raises:
            LockstepError: none of them changes it, and there is no timeout.
        """
        return wait_in_callback(self.scheduler, self.guests, condition, timeout_s)


class _RunInProgress:
    """The run in progress in this process; the patched functions use it."""

    def __init__(self) -> None:
        self.interception: Interception | None = None
        self.importing: int | None = None
        """Id of the thread that imports nodes."""
        self.of_modules: dict[str, random.Random] = {}
        """Randomness of each module during its import, independent of earlier imports."""

    def entropy(self) -> random.Random | None:
        """Return what replaces the system's randomness for the caller; None if nothing does."""
        run = self.inside()
        if run is not None:
            return run.entropy
        if self.importing != threading.get_ident():
            return None
        frame: FrameType | None = sys._getframe(1)
        while frame is not None and _is_of(_OF_CHANCE, frame):
            frame = frame.f_back
        name = frame.f_globals.get("__name__", "") if frame is not None else ""
        if name not in self.of_modules:
            self.of_modules[name] = random.Random(f"import {name}")  # noqa: S311
        return self.of_modules[name]

    def inside(self) -> Interception | None:
        """Return the run if the caller is inside one of its callbacks, otherwise None."""
        run = self.interception
        return run if run is not None and run.is_inside() else None


_process: Final = _RunInProgress()
"""One per process, like the `time` and `os` modules."""


@contextmanager
def run_in_progress(interception: Interception) -> Iterator[None]:
    """Inside the `with` block, intercepted calls use this run."""
    before, _process.interception = _process.interception, interception
    try:
        yield
    finally:
        _process.interception = before


@contextmanager
def repeatable_import() -> Iterator[None]:
    """Make unseeded generators that this thread creates repeatable across processes."""
    before, _process.importing = _process.importing, threading.get_ident()
    try:
        yield
    finally:
        _process.importing = before


@contextmanager
def intercepted() -> Iterator[None]:
    """Replace the system's functions inside the `with` block."""
    with ExitStack() as stack:
        stack.enter_context(_pickled_by_name(datetime.datetime))
        for target, name, replacement in _replacements():
            stack.callback(setattr, target, name, getattr(target, name))
            setattr(target, name, replacement)
        yield


def _replacements() -> Iterator[tuple[Any, str, Any]]:
    functions: dict[Any, Any] = {time.sleep: _sleep_function(time.sleep)}
    for name in (*_IN_SECONDS, *_IN_NANOSECONDS):
        real = getattr(time, name)
        functions[real] = _simulated(real, in_seconds=name in _IN_SECONDS)
    for module in (time, *_TIMED):
        for name, value in list(vars(module).items()):
            if isinstance(value, BuiltinFunctionType) and value in functions:
                yield module, name, functions[value]
    defaults = sched.scheduler.__init__.__defaults__ or ()
    simulated_defaults = tuple(functions.get(value, value) for value in defaults)
    yield sched.scheduler.__init__, "__defaults__", simulated_defaults
    yield time, "clock_gettime", _clock_function(time.clock_gettime, in_seconds=True)
    yield time, "clock_gettime_ns", _clock_function(time.clock_gettime_ns, in_seconds=False)
    for name in _OF_A_TIME:
        yield time, name, _of_present(getattr(time, name))
    yield time, "strftime", _text_of_present(time.strftime)
    selector = selectors.DefaultSelector
    yield selector, "select", _select_function(selector.select)
    yield threading.Condition, "wait", _condition_wait_function(threading.Condition.wait)
    yield threading.Event, "wait", _wait_function(threading.Event.wait)
    for name, kind in (("Lock", NodeLock), ("RLock", NodeRLock)):
        lock = getattr(threading, name)
        yield threading, name, lock_class(lock, kind, _is_of_node, _wait_for_lock)
    yield threading.Thread, "join", _join_function(threading.Thread.join)
    yield datetime, "datetime", _datetime_class(datetime.datetime)
    yield Clock, "now", _now_of_clocks(Clock.now)
    yield Clock, "sleep_until", _sleep_of_clocks(Clock.sleep_until)
    urandom = _urandom_function(os.urandom)
    yield os, "urandom", urandom
    yield random, "_urandom", urandom
    if hasattr(os, "getrandom"):
        yield os, "getrandom", _urandom_function(os.getrandom)
    # C code seeds generators from the system without calling `os`.
    seed = _seed_function(random.Random.seed)
    yield random.Random, "seed", seed
    yield random, "seed", functools.partial(seed, cast(Any, random.seed).__self__)
    yield threading.Thread, "start", _start_function(threading.Thread.start)
    log = rclpy_implementation.rclpy_logging_rcutils_log
    yield rclpy_implementation, "rclpy_logging_rcutils_log", _log_function(log)
    yield Node, "__init__", _node_constructor(Node.__init__)
    yield Executor, "wait_for_ready_callbacks", _wait_of_executor(Executor.wait_for_ready_callbacks)
    for name in ("shutdown", "try_shutdown"):
        yield Context, name, _shutdown_function(getattr(Context, name))
    default = _default_context_function(utilities.get_default_context)
    yield utilities, "get_default_context", default


def _simulated(real: Callable[[], Any], *, in_seconds: bool) -> Callable[[], Any]:
    def call() -> Any:
        run = _process.inside()
        if run is None or _is_of(_OF_PROCESSES, sys._getframe(1)):
            return real()
        time_ns = run.scheduler.time_ns
        return time_ns / NS_PER_S if in_seconds else time_ns

    return call


def _clock_function(real: Callable[[int], Any], *, in_seconds: bool) -> Callable[[int], Any]:
    simulated = frozenset(getattr(time, name) for name in _CLOCKS if hasattr(time, name))

    def call(clock: int) -> Any:
        run = _process.inside()
        if run is None or clock not in simulated:
            return real(clock)
        time_ns = run.scheduler.time_ns
        return time_ns / NS_PER_S if in_seconds else time_ns

    return call


def _of_present(real: Callable[..., Any]) -> Callable[..., Any]:
    def call(seconds: float | None = None) -> Any:
        run = _process.inside()
        if seconds is None and run is not None:
            seconds = run.scheduler.time_ns / NS_PER_S
        return real(seconds)

    return call


def _text_of_present(real: Callable[..., str]) -> Callable[..., str]:
    def call(form: str, *given: Any) -> str:
        # `time.localtime` is replaced too.
        return real(form, *(given or (time.localtime(),)))

    return call


def _sleep_function(real: Callable[[float], None]) -> Callable[[float], None]:
    def sleep(seconds: float) -> None:
        run, guest = _process.inside(), guest_of(threading.current_thread())
        if seconds < 0 or _is_of(_OF_PROCESSES, sys._getframe(1)):
            real(seconds)  # raises an error if negative
        elif guest is not None:
            guest.sleep(seconds)  # also while it ends after the run
        elif run is None:
            real(seconds)
        else:
            run.scheduler.sleep(seconds)

    return sleep


def _wait_function(real: Callable[..., bool]) -> Callable[..., bool]:
    of_start = threading.Thread.start.__code__

    def wait(self: threading.Event, timeout: float | None = None) -> bool:
        run, caller = _process.inside(), sys._getframe(1)
        # Events that rclpy waits for belong to blocking calls such as `send_goal`. `Thread.start`
        # waits until the new thread exists.
        if run is None or caller.f_code is of_start or _is_of(_OWN_WAITS, caller):
            return real(self, timeout)
        guest = guest_of(threading.current_thread())
        if guest is not None:
            return guest.wait_for(self.is_set, timeout)
        if self.is_set() or run.has_threads:
            return real(self, timeout)
        return run.wait(self.is_set, timeout)

    return wait


def _condition_wait_function(real: Callable[..., bool]) -> Callable[..., bool]:
    """Replace `Condition.wait`, which queues and semaphores use too.

    Source: https://github.com/python/cpython/blob/3.11/Lib/threading.py
    """
    of_event = threading.Event.wait.__code__

    def wait(self: Any, timeout: float | None = None) -> bool:
        run, guest = _process.inside(), guest_of(threading.current_thread())
        if (guest is None and run is None) or sys._getframe(1).f_code is of_event:
            return real(self, timeout)
        if guest is None and cast(Interception, run).has_threads:
            is_notified = real(self, timeout)
            if not is_notified and timeout is not None:
                # Loops such as that of `wait_for` end when the time is over.
                cast(Interception, run).scheduler.sleep(timeout)
            return is_notified
        wait_for = guest.wait_for if guest is not None else cast(Interception, run).wait
        notified = threading.Lock()
        notified.acquire()
        self._waiters.append(notified)
        saved = self._release_save()
        try:
            is_notified = wait_for(lambda: notified.acquire(blocking=False), timeout)
        finally:
            self._acquire_restore(saved)
        if not is_notified:
            with suppress(ValueError):
                self._waiters.remove(notified)
        return is_notified

    return wait


def _is_of_node(frame: FrameType) -> bool:
    """Whether a node's code runs in a frame."""
    is_importing = _process.importing == threading.get_ident()
    return (is_importing or _process.inside() is not None) and not _is_of(_WITH_REAL_LOCKS, frame)


def _wait_for_lock(lock: NodeLock, timeout: float) -> bool:
    limit_s = None if timeout < 0 else timeout
    while (guest := guest_of(threading.current_thread())) is not None:
        if guest.wait_for(lock.take, limit_s):
            return True
        if limit_s is not None:
            return False
        # The thread must end, or it has just left lockstep.
    run = _process.inside()
    if run is None or (run.has_threads and not run.has_guest(lock.holder)):
        is_acquired: bool = lock.real.acquire(timeout=timeout)
        if run is not None and not is_acquired:
            run.scheduler.sleep(timeout)  # loops end when the time is over
        return is_acquired
    return run.wait(lock.take, limit_s)


def _join_function(real: Callable[..., None]) -> Callable[..., None]:
    def join(self: threading.Thread, timeout: float | None = None) -> None:
        guest, run = guest_of(self), _process.inside()
        own = guest_of(threading.current_thread())
        if guest is None or guest.has_ended or isinstance(self, GuestThread):
            real(self, timeout)
        elif own is not None:
            own.wait_for(lambda: guest.has_ended, timeout)
        elif run is not None:
            run.wait(lambda: guest.has_ended, timeout)
        else:
            guest.end(timeout)
            real(self, timeout)

    return join


def _select_function(real: Callable[..., Any]) -> Callable[..., Any]:
    def select(self: selectors.BaseSelector, timeout: float | None = None) -> Any:
        run = _process.inside()
        if run is None or not timeout or not _is_of(_EVENT_LOOPS, sys._getframe(1)):
            return real(self, timeout)
        is_guest = guest_of(threading.current_thread()) is not None
        # Threads such as those of `asyncio.to_thread` wake the loop, in real time.
        ready = real(self, timeout if run.has_threads and not is_guest else 0)
        if not ready:
            take_time(run.scheduler, timeout)  # `asyncio.sleep` waits here
        return ready

    return select


def _is_of(modules: tuple[str, ...], frame: FrameType) -> bool:
    return f"{frame.f_globals.get('__name__', '')}.".startswith(modules)


def _datetime_class(real: type[datetime.datetime]) -> type[datetime.datetime]:
    class IsDatetime(type):
        """Makes `isinstance` accept the real class's instances, which C code creates."""

        def __instancecheck__(cls, instance: object) -> bool:
            return isinstance(instance, real)

        def __subclasscheck__(cls, subclass: type) -> bool:
            return issubclass(subclass, real)

    class SimulatedDatetime(real, metaclass=IsDatetime):  # type: ignore[misc, valid-type]
        """`datetime` that uses the simulated time inside callbacks."""

        def __new__(cls, *args: Any, **kwargs: Any) -> Any:
            # Libraries such as YAML look up an object's class, and do not know this one.
            return real.__new__(real if cls is SimulatedDatetime else cls, *args, **kwargs)

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
    SimulatedDatetime.__module__ = real.__module__
    return SimulatedDatetime


@contextmanager
def _pickled_by_name(real: type[datetime.datetime]) -> Iterator[None]:
    """Let pickle save objects of a class although its name now refers to the simulated one."""

    def reduce(value: datetime.datetime) -> tuple[Any, ...]:
        return datetime.datetime, *cast(tuple[Any, ...], value.__reduce_ex__(4))[1:]

    copyreg.pickle(cast(Any, real), cast(Any, reduce))
    try:
        yield
    finally:
        del copyreg.dispatch_table[real]


def _now_of_clocks(real: Callable[[Any], Time]) -> Callable[[Any], Time]:
    def now(self: Clock) -> Time:
        run = _process.inside()
        if run is None:
            return real(self)
        return Time(nanoseconds=run.scheduler.time_ns, clock_type=self.clock_type)

    return now


def _sleep_of_clocks(real: Callable[..., bool]) -> Callable[..., bool]:
    def sleep_until(self: Clock, until: Time, context: Context | None = None) -> bool:
        run = _process.inside()
        if run is None or until.clock_type != self.clock_type:
            return real(self, until, context)
        left_ns = until.nanoseconds - run.scheduler.time_ns
        if left_ns > 0:
            take_time(run.scheduler, left_ns / NS_PER_S)
        return True

    return sleep_until


def _urandom_function(real: Callable[..., bytes]) -> Callable[..., bytes]:
    def urandom(size: int, *flags: int) -> bytes:
        entropy = _process.entropy()
        return real(size, *flags) if entropy is None else entropy.randbytes(size)

    return urandom


def _seed_function(real: Callable[..., None]) -> Callable[..., None]:
    def seed(self: random.Random, a: Any = None, version: int = 2) -> None:
        if a is None and (entropy := _process.entropy()) is not None:
            a = entropy.getrandbits(_SEED_BITS)
        real(self, a, version)

    return seed


def _start_function(real: Callable[[threading.Thread], None]) -> Callable[[Any], None]:
    def start(self: Any) -> None:
        run, caller = _process.inside(), sys._getframe(1)
        if run is None or run.scheduler.running is None or _is_of(_OWN_THREADS, caller):
            real(self)
            return
        node = run.scheduler.running
        leave = functools.partial(_leave_lockstep, run, node, self.name, user_place())
        if _is_of(_THREAD_STARTERS, caller):
            leave()
            real(self)
            return
        guest = Guest(run.scheduler, node, self, leave)
        run.guests.append(guest)
        self.lockstep_guest = guest
        self.run = functools.partial(guest.run, self.run)
        real(self)
        guest.start()

    return start


def _leave_lockstep(run: Interception, node: ScheduledNode, thread: str, place: str) -> None:
    run.with_threads.add(node)
    run.scheduler.note(
        ("thread", place),
        f"the thread `{thread}` of {node.name}, started in {place}, is not in lockstep, because it "
        "waits for something outside the run: its behavior may differ between runs",
    )


def _node_constructor(real: Callable[..., None]) -> Callable[..., None]:
    def construct(self: Node, node_name: str, *args: Any, **kwargs: Any) -> None:
        run = _process.inside()
        if run is not None and not isinstance(self, GuardedLifecycleNode):
            raise run.scheduler.stop(_plain_node_error(node_name))
        real(self, node_name, *args, **kwargs)

    return construct


def _plain_node_error(name: str) -> LockstepError:
    return LockstepError(
        f"the plain rclpy node `{name}` ({user_place()}) cannot run in lockstep, because its "
        "messages and timers would use DDS. Derive its class from `ObeliskNode` or another base "
        "class of the library, or leave the node out and replace it with `stub`"
    )


@contextmanager
def refuse_plain_nodes() -> Iterator[None]:
    """Inside the `with` block, no thread may create a plain rclpy node; for loading programs.

    Raises:
        LockstepError: a program creates such a node.
    """
    real = Node.__init__

    def construct(self: Node, node_name: str, *args: Any, **kwargs: Any) -> None:
        if not isinstance(self, GuardedLifecycleNode):
            raise _plain_node_error(node_name)
        real(self, node_name, *args, **kwargs)

    setattr(Node, "__init__", construct)  # noqa: B010 - mypy
    try:
        yield
    finally:
        setattr(Node, "__init__", real)  # noqa: B010


def _wait_of_executor(real: Callable[..., Any]) -> Callable[..., Any]:
    def wait_for_ready_callbacks(self: Executor, *args: Any, **kwargs: Any) -> Any:
        run = _process.inside()
        if run is not None:
            node = run.scheduler.running
            raise run.scheduler.stop(
                LockstepError(
                    f"{node.name if node else 'a node'} spins an executor in a callback "
                    f"({user_place()}): in a real run it would wait for itself. Use `await`, or a "
                    "done callback of the future"
                )
            )
        return real(self, *args, **kwargs)

    return wait_for_ready_callbacks


def _shutdown_function(real: Callable[[Context], None]) -> Callable[[Context], None]:
    def shutdown(self: Context) -> None:
        run = _process.inside()
        if run is None or run.scheduler.running is None:
            real(self)
        else:
            run.scheduler.on_exit(
                run.scheduler.running, "ended its process by calling `rclpy.shutdown()`"
            )

    return shutdown


def _default_context_function(real: Callable[..., Context]) -> Callable[..., Context]:
    def get_default_context(*, shutting_down: bool = False) -> Context:
        # Otherwise rclpy drops the context before shutting it down.
        return real(shutting_down=shutting_down and _process.inside() is None)

    return get_default_context


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
