"""Which frame of a film shows which state: arithmetic of simulation time.

In: the time of each state, in the order in which they came. Out: numbers of frames. When time jumps
back (a reset, a new activation) the film goes on where it was: the state is its next frame.
"""

from math import floor
from typing import Final

__all__ = ["FrameNumbers"]


_TOLERANCE: Final = 1e-6
"""Of a frame: time as a sum of steps may be a hair below it."""


class FrameNumbers:
    """Counts the frames of one film."""

    def __init__(self, rate_hz: int) -> None:
        """Begin a film with so many frames in a second of simulation time."""
        self._rate_hz = rate_hz
        self._first = 0
        """Number of the frame that shows `_begin_s`."""
        self._begin_s: float | None = None
        self._newest_s = 0.0
        self.count = 0
        """Frames up to that of the newest state."""

    def take(self, time_s: float) -> int | None:
        """The frame for a state.

        Args:
            time_s: its simulation time [s].

        Returns:
            The frame's number; None where another state is in that frame already.
        """
        if self._begin_s is None or time_s < self._newest_s:
            self._begin_s, self._first = time_s, self.count
        self._newest_s = time_s
        number = self._first + floor((time_s - self._begin_s) * self._rate_hz + _TOLERANCE)
        if number < self.count:
            return None
        self.count = number + 1
        return number
