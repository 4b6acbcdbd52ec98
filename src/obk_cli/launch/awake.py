"""Time as this process could use it: what it spent stopped (Ctrl-Z) counts for no deadline."""

from collections.abc import Callable
from typing import Final

__all__ = ["SLICE_S", "AwakeClock"]

SLICE_S: Final = 0.5
"""One wait takes no longer [s]; where it does by as much again, this process stood still."""


class AwakeClock:
    """Gives the time; is told of every wait."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """Begin with a monotonic clock [s]."""
        self._clock = clock
        self._stood_still_s = 0.0

    def __call__(self) -> float:
        """Monotonic time without that in which this process stood still [s]."""
        return self._clock() - self._stood_still_s

    def waited(self, begin: float, longest_s: float | None) -> None:
        """A wait is over.

        Args:
            begin: when it began.
            longest_s: how long it should have taken at most; None: for ever.
        """
        passed_s = self() - begin
        if longest_s is not None and passed_s > longest_s + SLICE_S:
            self._stood_still_s += passed_s
