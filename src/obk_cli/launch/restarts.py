"""How often and how soon what crashed is started again: exponential back-off within a budget."""

from collections import deque
from typing import Final

__all__ = ["Budget"]

FIRST_WAIT_S: Final = 0.1
LONGEST_WAIT_S: Final = 5.0


class Budget:
    """The restarts of one process."""

    def __init__(self, *, attempts: int, window_s: float) -> None:
        """Allow so many restarts within any window of that length [s]."""
        self._attempts = attempts
        self._window_s = window_s
        self._times: deque[float] = deque()
        self.count = 0
        """Restarts over the whole run."""

    @property
    def attempt(self) -> int:
        """The number of the newest restart within its window, from 1."""
        return len(self._times)

    def spend(self, now: float) -> float | None:
        """Take one restart.

        Args:
            now: monotonic time [s].

        Returns:
            how long to wait before it [s]: 0.1, doubled by each one in the window, 5 at most;
            None when the budget is spent.
        """
        while self._times and now - self._times[0] > self._window_s:
            self._times.popleft()
        if len(self._times) >= self._attempts:
            return None
        self._times.append(now)
        self.count += 1
        return float(min(LONGEST_WAIT_S, FIRST_WAIT_S * 2 ** (len(self._times) - 1)))
