"""A film of a simulation: states in, one file out when they are over.

Simulation time is film time. A frame that could not be drawn in time is left out: the one before it
is seen longer, so the film plays at the simulation's speed, and how many were dropped is told.
"""

import os
import signal
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import IO, Final

import av
import mujoco
import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.exceptions import ObeliskError
from obelisk_py.core.sim.mujoco.cameras import CameraView, choose_back_end
from obelisk_py.core.sim.mujoco.viewing.film_files import FILM_FILES, PngFile
from obelisk_py.core.sim.mujoco.viewing.film_order import FilmOrder
from obelisk_py.core.sim.mujoco.viewing.film_place import unfinished
from obelisk_py.core.sim.mujoco.viewing.film_shooting import Shooting
from obelisk_py.core.sim.mujoco.viewing.program import NICENESS
from obelisk_py.core.sim.mujoco.viewing.states import States
from obelisk_py.core.sim.mujoco.viewing.words import Tell

__all__ = ["BEGUN", "look"]

BEGUN: Final = "a film goes to "
"""Begins the first sentence; the launcher looks for it."""
_WAIT_S: Final = 1.0
_LAST_S: Final = 0.7
"""For what is being drawn at the end [s]."""
_LARGEST_SHADOW: Final = 2048
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
    make = _picture if path.suffix == ".png" else _film
    # OpenGL belongs to one thread.
    thread = ThreadPoolExecutor(1, thread_name_prefix="drawing")
    view = thread.submit(_view, states.model, order).result()
    try:
        with unfinished(path.parent) as place:
            states.take_next()
            told = make(states, view, order, place.file, thread, tell)
            tell("info", f"film: {place.finish(path)}, {told}")
    except (BrokenPipeError, ConnectionResetError):
        raise
    except (OSError, av.FFmpegError) as error:
        raise ObeliskError(f"{path}: {error.strerror or error}") from error
    # OpenGL takes longer to close than a film, and nobody needs it any more.
    os._exit(0)


def _view(model: mujoco.MjModel, order: FilmOrder) -> CameraView:
    quality = model.vis.quality
    quality.shadowsize = min(quality.shadowsize, _LARGEST_SHADOW)
    return CameraView(model, order.camera, choose_back_end(), (order.width, order.height))


def _film(
    states: States,
    view: CameraView,
    order: FilmOrder,
    file: IO[bytes],
    thread: ThreadPoolExecutor,
    tell: Tell,
) -> str:
    """Draw what comes; in words what there is."""
    ending = Path(order.path).suffix
    film = FILM_FILES[ending](file, (order.width, order.height), order.rate_hz)
    shooting = Shooting(states, film, order.rate_hz)
    # The first picture takes longest; nothing is simulated before it.
    thread.submit(shooting.draw_one, view).result()
    _make_way()
    tell("info", f"{BEGUN}{order.path}")
    drawing = thread.submit(shooting.draw_all, view)
    # Who draws is done before that only if the file takes no more.
    while not (states.wait_until_over(_WAIT_S) or drawing.done()):
        pass
    with suppress(TimeoutError):
        drawing.result(_LAST_S)
    return shooting.close()


def _picture(
    states: States,
    view: CameraView,
    order: FilmOrder,
    file: IO[bytes],
    thread: ThreadPoolExecutor,
    tell: Tell,
) -> str:
    """Draw the last state of all; in words which it is."""

    def draw() -> NDArray[np.uint8]:
        view.update(states.data)
        return view.draw()

    thread.submit(draw).result()
    tell("info", f"{BEGUN}{order.path}")
    while not states.is_over:
        states.take_newest(_WAIT_S)
    film = PngFile(file, (order.width, order.height), order.rate_hz)
    film.show(thread.submit(draw).result(), 0)
    film.end()
    return f"the state at {states.data.time:.3f} s"


def _make_way() -> None:
    """Let the robot come first from here on; only the thread that ends the film keeps its place.

    Who has made way cannot take it back, and a busy machine would not let the film come to its end.
    """
    for thread in Path("/proc/self/task").iterdir():
        if int(thread.name) != threading.main_thread().native_id:
            os.setpriority(os.PRIO_PROCESS, int(thread.name), NICENESS)
