"""Run a node's own threads in lockstep: a thread runs during its turn and ends it by sleeping."""

import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, Final

from obelisk_py.core.lockstep.scheduler import (
    NS_PER_S,
    STEP,
    LockstepError,
    ScheduledNode,
    Scheduler,
    user_place,
    wait_ns,
)

__all__ = ["Guest", "GuestThread", "guest_of", "take_time", "wait_in_callback"]

LONGEST_TURN_S: Final = 5.0
"""Maximum time of a turn without a sleep [s]: CPU time, so that it does not depend on the load of
the machine, or wall time in which the thread is blocked. After this, the run fails: the thread
never ends its turn, or waits for something that cannot happen during it."""
_POLL_S: Final = 0.001
"""Simulated time between two checks of a condition that a thread waits for [s]."""
_WALL_POLL_S: Final = 0.01
"""Wall time between two checks of a thread that has the turn [s]."""
_BLOCKED_POLLS: Final = 20
"""Consecutive checks after which a sleeping thread counts as blocked from outside the run."""


class Guest:
    """The turns of a thread: either the thread or the scheduler runs, never both."""

    def __init__(
        self,
        scheduler: Scheduler,
        node: ScheduledNode,
        thread: threading.Thread,
        on_leave: Callable[[], None] | None = None,
    ) -> None:
        """Prepare turns for a thread; the first one follows `start`.

        Args:
            scheduler: the run's scheduler.
            node: the node that owns the thread.
            thread: the thread that calls `run`.
            on_leave: called if the thread blocks, for example on a socket, and therefore continues
                without turns. If None, blocking ends the run with an error, as does an exception in
                the thread.
        """
        self.node = node
        self.wake_ns: int | None = None
        """Simulated time of its next turn [ns]; None if it has none."""
        self.has_left = False
        """Whether the thread continues without turns."""
        self._scheduler = scheduler
        self._thread = thread
        self._on_leave = on_leave
        # Plain locks: a semaphore waits on a condition, which would take simulated time.
        self._its_turn, self._turn_over = threading.Lock(), threading.Lock()
        self._its_turn.acquire()
        self._turn_over.acquire()
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._error: BaseException | None = None
        self._is_ending = False
        self._is_last_sleep = False
        """Whether a loop that should have ended has slept once more."""
        self._turns = 0
        self._cpu_clock: int | None = None
        """The clock of the thread's CPU time; None before its start."""

    @property
    def thread_id(self) -> int | None:
        """Id of the thread; None before its start."""
        return self._thread.ident

    @property
    def has_ended(self) -> bool:
        """Whether the thread's function has returned."""
        return self._ended.is_set()

    def start(self) -> None:
        """Schedule the first turn now."""
        self.wake_ns = self._scheduler.time_ns
        self._push()

    def run(self, body: Callable[[], object]) -> None:
        """Run the thread's function; call this on the thread."""
        self._cpu_clock = time.pthread_getcpuclockid(threading.get_ident())
        self._its_turn.acquire()
        try:
            if not self._is_ending:
                body()
        except BaseException as error:
            if not self._is_ending:  # otherwise waits end early, without what they wait for
                self._error = error
                raise
        finally:
            self.wake_ns = None
            self._ended.set()
            _open(self._turn_over)

    def sleep(self, seconds: float) -> None:
        """End this turn and schedule the next one after `seconds`; call this on the thread.

        Raises:
            SystemExit: the thread must end, but its loop continues.
        """
        if self._is_ending:
            if self._is_last_sleep:
                raise SystemExit
            self._is_last_sleep = True
            return
        with self._lock:
            if self.has_left:
                return
            self.wake_ns = self._scheduler.time_ns + wait_ns(seconds)
            _open(self._turn_over)
        self._its_turn.acquire()

    def wait_for(self, condition: Callable[[], bool], timeout_s: float | None) -> bool:
        """Sleep until a condition is true; call this on the thread."""
        end_ns = None if timeout_s is None else self._scheduler.time_ns + wait_ns(timeout_s)
        while not condition():
            left_s = _POLL_S
            if end_ns is not None:
                left_s = min(left_s, (end_ns - self._scheduler.time_ns) / NS_PER_S)
                if left_s <= 0.0:
                    return False
            self.sleep(left_s)
            if self._is_ending or self.has_left:
                return condition()
        return True

    def take_turn(self) -> None:
        """Let the thread run until it sleeps, ends or blocks.

        Raises:
            LockstepError: the thread does none of these within `LONGEST_TURN_S`.
        """
        self._turns += 1
        _open(self._its_turn)
        self._await_end_of_turn()
        if self._on_leave is None and self._error is not None:
            raise self._error
        if self.wake_ns is not None:
            self._push()

    def end(self, timeout_s: float | None = None) -> None:
        """Let the thread finish; from now on, its sleeps take no time.

        Args:
            timeout_s: maximum time to wait [s]; None uses `LONGEST_TURN_S`.
        """
        if self.has_left:
            return
        self._is_ending = True
        _open(self._its_turn)
        self._ended.wait(LONGEST_TURN_S if timeout_s is None else timeout_s)

    def _push(self) -> None:
        assert self.wake_ns is not None
        turn = partial(self._turn, self._turns)
        self._scheduler.push(self.wake_ns, STEP, self.node, turn)

    def _turn(self, number: int) -> bool:
        if number != self._turns or self._is_ending:
            return False  # a callback that waited for the thread has already let it run
        self.take_turn()
        return True

    def _await_end_of_turn(self) -> None:
        blocked, end_s = 0, self._cpu_s() + LONGEST_TURN_S
        while not self._turn_over.acquire(timeout=_WALL_POLL_S):
            blocked = blocked + 1 if self._is_asleep() else 0
            if blocked >= _BLOCKED_POLLS and self._leave():
                return
            if self._cpu_s() > end_s or blocked * _WALL_POLL_S > LONGEST_TURN_S:
                raise LockstepError(
                    f"the thread `{self._thread.name}` of {self.node.name} neither slept nor ended "
                    f"within {LONGEST_TURN_S:g} s: a thread in lockstep must wait, as in "
                    f"`time.sleep`. It is in\n{self._stack()}"
                )

    def _cpu_s(self) -> float:
        """CPU time of the thread [s]."""
        if self._cpu_clock is None:
            return 0.0
        try:
            return time.clock_gettime(self._cpu_clock)
        except OSError:
            return 0.0  # the thread has ended

    def _is_asleep(self) -> bool:
        """Whether the operating system reports the thread as sleeping.

        Source: https://man7.org/linux/man-pages/man5/proc_pid_stat.5.html
        """
        try:
            stat = Path(f"/proc/self/task/{self._thread.native_id}/stat").read_text()
        except OSError:
            return False  # the thread has ended
        return stat.rpartition(")")[2].split()[0] == "S"

    def _leave(self) -> bool:
        """Stop giving turns; false if the turn has ended or the thread may not leave."""
        if self._on_leave is None:
            return False
        with self._lock:
            if not self._turn_over.locked():
                return False
            self.has_left = True
            self.wake_ns = None
        self._on_leave()
        return True

    def _stack(self) -> str:
        """Return the thread's current call stack."""
        frame = sys._current_frames().get(self._thread.ident or 0)
        return "".join(traceback.format_stack(frame)) if frame is not None else "no frame"


def _open(lock: threading.Lock) -> None:
    if lock.locked():
        lock.release()


class GuestThread(threading.Thread):
    """A thread of the library with turns; its exceptions end the run."""

    def __init__(
        self, scheduler: Scheduler, node: ScheduledNode, target: Callable[[], None], name: str
    ) -> None:
        """Create the thread without starting it."""
        super().__init__(name=name, daemon=True)
        self._body = target
        self.lockstep_guest = Guest(scheduler, node, self)

    def start(self) -> None:
        """Start the thread; its first turn is now."""
        super().start()
        self.lockstep_guest.start()

    def run(self) -> None:
        """Run the thread's function; called by `threading`."""
        with suppress(BaseException):  # the scheduler raises it
            self.lockstep_guest.run(self._body)

    def join(self, timeout: float | None = None) -> None:
        """Let the thread finish; from now on, its sleeps take no time."""
        self.lockstep_guest.end(timeout)
        super().join(timeout)


def guest_of(thread: Any) -> Guest | None:
    """Return the turns of a thread; None if it has no turns or no longer has any."""
    guest: Guest | None = getattr(thread, "lockstep_guest", None)
    return guest if guest is not None and not guest.has_left else None


def take_time(scheduler: Scheduler, seconds: float) -> None:
    """Let the calling guest thread or callback take simulated time [s]."""
    guest = guest_of(threading.current_thread())
    if guest is not None:
        guest.sleep(seconds)
    else:
        scheduler.sleep(seconds)


def wait_in_callback(
    scheduler: Scheduler,
    guests: Iterable[Guest],
    condition: Callable[[], bool],
    timeout_s: float | None,
) -> bool:
    """Give turns to the threads of the running node until a condition is true.

    The callback takes the simulated time that they need.

    Args:
        scheduler: the run's scheduler.
        guests: all threads that have turns.
        condition: the condition that the callback waits for.
        timeout_s: maximum simulated time to wait [s]; None for no limit.

    Returns:
        Whether the condition is true.

    Raises:
        LockstepError: it is false, no thread can change it, and there is no timeout.
    """
    end_ns = None if timeout_s is None else scheduler.time_ns + wait_ns(timeout_s)
    while not condition():
        waiting = [
            (guest.wake_ns, place, guest)
            for place, guest in enumerate(guests)
            if guest.wake_ns is not None and guest.node is scheduler.running
        ]
        if not waiting:
            break
        wake_ns, _, guest = min(waiting)
        if end_ns is not None and wake_ns > end_ns:
            break
        scheduler.sleep(max(0, wake_ns - scheduler.time_ns) / NS_PER_S)
        guest.take_turn()
    else:
        return True
    if end_ns is None:
        raise scheduler.stop(
            LockstepError(
                f"{scheduler.running.name if scheduler.running else 'a callback'} waits in a "
                f"callback for an event or a lock ({user_place()}) that no other callback can set "
                "or release meanwhile: with one thread that is a deadlock. Use `await` or a done "
                "callback"
            )
        )
    scheduler.sleep((end_ns - scheduler.time_ns) / NS_PER_S)
    return condition()
