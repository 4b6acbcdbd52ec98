"""End a run in which a callback computes endlessly, so that a test fails instead of hanging."""

import ctypes
import sys
import threading
import time
from typing import Final

from obelisk_py.core.lockstep.scheduler import LockstepError, Scheduler, user_place

__all__ = ["CallbackLimit"]

LONGEST_CALLBACK_S: Final = 60.0
"""Maximum CPU time of a callback, transition or constructor [s]. Compiling a policy in the first
callback takes less, and a debugger's prompt takes none."""
POLL_S: Final = 1.0


class CallbackLimit:
    """Watches the thread that runs the callbacks, from another thread."""

    def __init__(self, scheduler: Scheduler) -> None:
        """Start watching; call this on the thread that runs the callbacks."""
        self._scheduler = scheduler
        self._cpu_clock = time.pthread_getcpuclockid(threading.get_ident())
        self._is_closed = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="callback limit", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop watching."""
        self._is_closed.set()
        self._thread.join()

    def _watch(self) -> None:
        scheduler = self._scheduler
        calls, since_s = -1, 0.0
        while not self._is_closed.wait(POLL_S):
            now_s = time.clock_gettime(self._cpu_clock)
            if scheduler.running is None or scheduler.calls != calls:
                calls, since_s = scheduler.calls, now_s
            elif now_s - since_s > LONGEST_CALLBACK_S:
                self._interrupt()

    def _interrupt(self) -> None:
        """Raise an error in the callback."""
        thread_id, node = self._scheduler.thread_id, self._scheduler.running
        frame = sys._current_frames().get(thread_id)
        text = (
            f"{node.name if node else 'a callback'} has computed for {LONGEST_CALLBACK_S:g} s in "
            f"one callback and is at {user_place(frame)}: it probably never ends"
        )

        class EndlessCallbackError(LockstepError):
            """Has its message in the class, because Python creates the object."""

            def __str__(self) -> str:
                return text

        self._scheduler.stop(LockstepError(text))
        # Takes effect between two bytecodes, so not while a C function runs.
        raise_in = ctypes.pythonapi.PyThreadState_SetAsyncExc
        raise_in(ctypes.c_ulong(thread_id), ctypes.py_object(EndlessCallbackError))
