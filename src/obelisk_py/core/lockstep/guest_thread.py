"""A node's own thread in lock-step: it runs during its turn, which it ends by sleeping."""

import sys
import threading
import traceback
from collections.abc import Callable
from typing import Final

from obelisk_py.core.lockstep.scheduler import (
    NS_PER_S,
    STEP,
    LockstepError,
    ScheduledNode,
    Scheduler,
)

__all__ = ["GuestThread", "take_time"]

LONGEST_TURN_S: Final = 5.0
"""Wall time that a turn may take without a sleep [s]; then it waits for something that no other
node can do meanwhile, or does not end."""
_LOOK_S: Final = 0.001
"""Simulated time between two looks at what a thread waits for [s]."""


class GuestThread(threading.Thread):
    """A thread that takes turns with the scheduler: one of the two runs, never both."""

    def __init__(
        self, scheduler: Scheduler, node: ScheduledNode, target: Callable[[], None], name: str
    ) -> None:
        """Make a thread that is not started."""
        super().__init__(name=name, daemon=True)
        self._scheduler = scheduler
        self._node = node
        self._body = target
        self._its_turn, self._turn_over = threading.Semaphore(0), threading.Semaphore(0)
        self._wake_ns: int | None = 0
        """When its next turn is [ns]; None: it has ended."""
        self._error: BaseException | None = None
        self._is_ending = False
        self._is_last_sleep = False
        """Whether a loop that should have ended by now sleeps once more."""
        self._has_begun = False

    def start(self) -> None:
        """Have the first turn now."""
        self._scheduler.push(self._scheduler.time_ns, STEP, self._node, self._turn)

    def run(self) -> None:
        """Run the thread's function; called by `threading`."""
        self._its_turn.acquire()
        try:
            self._body()
        except BaseException as error:
            self._error = error
        finally:
            self._wake_ns = None
            self._turn_over.release()

    def sleep(self, seconds: float) -> None:
        """End this turn; the next one is so much later. Called on this thread.

        Raises:
            SystemExit: the thread has to end, and its loop has not noticed.
        """
        if self._is_ending:
            if self._is_last_sleep:
                raise SystemExit
            self._is_last_sleep = True
            return
        self._wake_ns = self._scheduler.time_ns + max(0, round(seconds * NS_PER_S))
        self._turn_over.release()
        self._its_turn.acquire()

    def wait_for(self, condition: Callable[[], bool], timeout_s: float | None) -> bool:
        """Sleep until a condition holds; called on this thread."""
        end_ns = None if timeout_s is None else self._scheduler.time_ns + timeout_s * NS_PER_S
        while not condition() and not self._is_ending:
            left_s = _LOOK_S
            if end_ns is not None:
                left_s = min(left_s, (end_ns - self._scheduler.time_ns) / NS_PER_S)
                if left_s <= 0.0:
                    return False
            self.sleep(left_s)
        return condition()

    def is_alive(self) -> bool:
        """Whether the thread's function has not returned."""
        return self._has_begun and super().is_alive()

    def join(self, timeout: float | None = None) -> None:
        """Let the thread come to its end: from now on its sleeps take no time."""
        if not self._has_begun:
            self._wake_ns = None
            return
        self._is_ending = True
        self._its_turn.release()
        super().join(LONGEST_TURN_S if timeout is None else timeout)

    def _turn(self) -> bool:
        if self._wake_ns is None or self._is_ending:
            return False
        if not self._has_begun:
            self._has_begun = True
            threading.Thread.start(self)
        self._its_turn.release()
        if not self._turn_over.acquire(timeout=LONGEST_TURN_S):
            raise LockstepError(
                f"the thread `{self.name}` of {self._node.name} neither slept nor ended within "
                f"{LONGEST_TURN_S:g} s: a thread in lock-step has to call `time.sleep`. It is in\n"
                f"{self._stack()}"
            )
        if self._error is not None:
            raise self._error
        if self._wake_ns is not None:
            self._scheduler.push(self._wake_ns, STEP, self._node, self._turn)
        return True

    def _stack(self) -> str:
        """What the thread executes now."""
        frame = sys._current_frames().get(self.ident or 0)
        return "".join(traceback.format_stack(frame)) if frame is not None else "no frame"


def take_time(scheduler: Scheduler, seconds: float) -> None:
    """Let the calling guest thread or callback take simulated time."""
    thread = threading.current_thread()
    if isinstance(thread, GuestThread):
        thread.sleep(seconds)
    else:
        scheduler.sleep(seconds)
