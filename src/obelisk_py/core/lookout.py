"""A thread that wakes when a robot's newest command becomes too old.

In: deadlines. Out: a call at each of them, on this thread, whatever the node's executor is busy
with. It sleeps from one deadline to the next, so commands that come in time cost nothing.
"""

import threading
import time
from collections.abc import Callable

__all__ = ["Lookout"]


class Lookout:
    """Looks after one run of a robot, from `start` to `stop`."""

    def __init__(self, deadline_s: Callable[[], float | None], look: Callable[[], None]) -> None:
        """Make a lookout that does not run yet.

        Args:
            deadline_s: gives the next deadline, a time of `time.monotonic`; None: there is none.
            look: called at each deadline, which is to give way to a later one then.
        """
        self._deadline_s = deadline_s
        self._look = look
        self._woken = threading.Event()
        self._is_ended = False
        self._thread = threading.Thread(target=self._run, name="lookout", daemon=True)

    def start(self) -> None:
        """Begin to look."""
        self._thread.start()

    def wake(self) -> None:
        """Have a deadline noticed where there was none before."""
        self._woken.set()

    def stop(self, timeout_s: float) -> bool:
        """End the thread; whether it ended in time, for which it is waited only the first time."""
        was_ended, self._is_ended = self._is_ended, True
        self._woken.set()
        self._thread.join(0 if was_ended else timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while not self._is_ended:
            deadline_s = self._deadline_s()
            left_s = None if deadline_s is None else deadline_s - time.monotonic()
            if left_s is None or left_s > 0:
                self._woken.wait(None if left_s is None else min(left_s, threading.TIMEOUT_MAX))
                self._woken.clear()
            else:
                self._look()
