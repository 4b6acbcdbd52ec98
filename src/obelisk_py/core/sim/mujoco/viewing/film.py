"""A film of a simulation: states in, one file out when they are over.

Simulation time is film time. A frame that could not be drawn in time is left out: the one before it
is seen longer, so the film plays at the simulation's speed, and how many were dropped is told.
"""

import os
import signal
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Final

import av
import mujoco

from obelisk_py.core.exceptions import ObeliskError
from obelisk_py.core.sim.mujoco.cameras import CameraView, choose_back_end
from obelisk_py.core.sim.mujoco.viewing.film_files import FILM_FILES, PngFile
from obelisk_py.core.sim.mujoco.viewing.film_numbers import FrameNumbers
from obelisk_py.core.sim.mujoco.viewing.film_order import FilmOrder
from obelisk_py.core.sim.mujoco.viewing.film_place import unfinished
from obelisk_py.core.sim.mujoco.viewing.program import NICENESS
from obelisk_py.core.sim.mujoco.viewing.states import States
from obelisk_py.core.sim.mujoco.viewing.words import Tell

__all__ = ["look"]

_WAIT_S: Final = 1.0
_QUICK_S: Final = 0.3
"""Of a picture: it can be drawn at the very end [s]."""
_LARGEST_SHADOW: Final = 1024
"""Side of the map that shadows are drawn from [pixels]. MuJoCo's own, 4096, takes a machine without
a graphics card more time than all the rest, and does not look better in a film."""


def look(states: States, tell: Tell, arguments: Sequence[str]) -> None:
    """Film until the states are over; tells when it begins, and what there is at the end.

    Raises:
        ObeliskError: nothing can be drawn here, or the file takes no more.
    """
    # It ends when there are no more states, and has a film to finish then.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    order = FilmOrder.from_arguments(arguments)
    path = Path(order.path)
    view = _view(states.model, order)
    made = _picture if path.suffix == ".png" else _film
    try:
        with unfinished(path.parent) as place:
            tell("info", f"a film goes to {path}")
            os.nice(NICENESS)
            told = made(states, view, order, place.file)
            if told is None:
                tell("warning", f"there is no film: nothing was simulated; {path} is not written")
            else:
                tell("info", f"film: {place.finish(path)}, {told}")
    except (BrokenPipeError, ConnectionResetError):
        raise
    except (OSError, av.FFmpegError) as error:
        raise ObeliskError(f"{path}: {error.strerror or error}") from error
    finally:
        view.close()


def _view(model: mujoco.MjModel, order: FilmOrder) -> CameraView:
    quality = model.vis.quality
    quality.shadowsize = min(quality.shadowsize, _LARGEST_SHADOW)
    return CameraView(model, order.camera, choose_back_end(), (order.width, order.height))


def _film(states: States, view: CameraView, order: FilmOrder, file: IO[bytes]) -> str | None:
    """Draw what comes; in words what there is, None if nothing came."""
    ending = Path(order.path).suffix
    film = FILM_FILES[ending](file, (order.width, order.height), order.rate_hz)
    numbers = FrameNumbers(order.rate_hz)
    picture, took_s = None, 0.0
    for is_last in _newest(states):
        number = numbers.take(states.data.time)
        if number is None:
            continue
        # A slow machine has no time to draw the very last state.
        if picture is None or not is_last or took_s < _QUICK_S:
            begin_s = time.monotonic()
            view.update(states.data)
            picture = view.draw()
            took_s = time.monotonic() - begin_s
        film.show(picture, number)
    if picture is None:
        return None
    film.end()
    return f"{numbers.shown} frames, {numbers.seconds:.1f} s, {numbers.dropped} dropped"


def _picture(states: States, view: CameraView, order: FilmOrder, file: IO[bytes]) -> str | None:
    """Draw the last state of all."""
    if not list(_newest(states)):
        return None
    view.update(states.data)
    film = PngFile(file, (order.width, order.height), order.rate_hz)
    film.show(view.draw(), 0)
    film.end()
    return f"the state at {states.data.time:.3f} s"


def _newest(states: States) -> Iterator[bool]:
    """Goes from state to state, the newest each time; whether it is the last one."""
    while not states.is_over:
        if states.take_newest(_WAIT_S):
            yield states.is_over
