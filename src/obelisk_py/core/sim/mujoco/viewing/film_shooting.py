"""A film while it is shot: one thread draws what comes, another one ends the film when it is over.

The thread that draws is niced below all that the robot does, so on a busy machine it may stand in
the middle of a picture for seconds. The end does not wait for it: the last picture is seen until
the time of the last state.
"""

import threading
from typing import Final

import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.sim.mujoco.cameras import CameraView
from obelisk_py.core.sim.mujoco.viewing.film_files import FilmFile
from obelisk_py.core.sim.mujoco.viewing.film_numbers import FrameNumbers
from obelisk_py.core.sim.mujoco.viewing.states import States

__all__ = ["Shooting"]

_WAIT_S: Final = 1.0


class Shooting:
    """A film from its first picture to its end."""

    def __init__(self, states: States, film: FilmFile, rate_hz: int) -> None:
        """Begin with no picture.

        Args:
            states: at the first one.
            film: takes the pictures.
            rate_hz: frames in a second of simulation time.
        """
        self._states = states
        self._film = film
        self._rate_hz = rate_hz
        self._lock = threading.Lock()
        """Of all that follows, the states and the film."""
        self._numbers = FrameNumbers(rate_hz)
        self._newest: int | None = self._numbers.take(states.data.time)
        """The frame of the newest state; None once it has a picture."""
        self._picture: NDArray[np.uint8] | None = None
        """What is seen by now."""
        self._shown = 0
        self._is_closed = False

    def draw_one(self, view: CameraView) -> None:
        """Draw the newest state."""
        with self._lock:
            number = self._newest
            view.update(self._states.data)
        picture = view.draw()
        with self._lock:
            if number is not None and not self._is_closed:
                self._show(picture, number)

    def draw_all(self, view: CameraView) -> None:
        """Draw what comes until it is over, or the film has been closed."""
        while self._take(_WAIT_S):
            if self._newest is not None:
                self.draw_one(view)

    def close(self) -> str:
        """End the film, whatever is still being drawn; in words what there is of it."""
        with self._lock:
            self._is_closed = True
            while not self._states.is_over:
                self._receive(_WAIT_S)
            if self._newest is not None and self._picture is not None:
                self._show(self._picture, self._newest)
            self._film.end()
        count = self._numbers.count
        frames = f"{self._shown} frame{'' if self._shown == 1 else 's'}"
        return f"{frames}, {count / self._rate_hz:.1f} s, {count - self._shown} dropped"

    def _take(self, timeout_s: float) -> bool:
        """Wait for a state; whether there may be more."""
        with self._lock:
            if self._is_closed or self._states.is_over:
                return False
            self._receive(timeout_s)
            return True

    def _receive(self, timeout_s: float) -> None:
        if self._states.take_newest(timeout_s):
            number = self._numbers.take(self._states.data.time)
            self._newest = self._newest if number is None else number

    def _show(self, picture: NDArray[np.uint8], number: int) -> None:
        self._film.show(picture, number)
        self._picture = picture
        self._newest = None
        self._shown += 1
