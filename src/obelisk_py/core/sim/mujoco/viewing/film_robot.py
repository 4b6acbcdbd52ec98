"""The film of a run on the robot's side: from ROS parameters to a process that draws it.

In: the node's parameters, the model. Out: an output that hands over a state for each frame. A film
that cannot be made fails before anything is simulated; one that breaks off is told, and the
simulation goes on.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import mujoco

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.cameras import picture_size
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.stepper import Output
from obelisk_py.core.sim.mujoco.stepping import SampleTimes
from obelisk_py.core.sim.mujoco.viewing.child import Onlooker
from obelisk_py.core.sim.mujoco.viewing.film_order import FilmOrder
from obelisk_py.core.sim.mujoco.viewing.words import Severity, Tell
from obelisk_spec.films import FilmError, FilmSettings, check_film_size, read_film
from obelisk_spec.suggestions import did_you_mean

__all__ = ["FILM_PARAMETERS", "film_order", "film_outputs", "film_wanted"]

FILM_PARAMETERS: Final[Mapping[str, str | int]] = MappingProxyType(
    {"render": "", "render_camera": "", "render_size": "", "render_fps": 0}
)
"""ROS parameter -> its default, whose type it keeps."""
_FILM: Final = "film: "
"""Begins the sentence that tells of the finished film; the launcher looks for it."""
_LOSS: Final = "there is no film"
_OPEN_S: Final = 30.0
"""OpenGL that takes longer to open will not open [s]."""
_END_S: Final = 2.5
"""For the last picture and the end of the file; a node has 3 s for a transition on its way down."""


def film_wanted(parameter: Callable[[str], Any]) -> FilmSettings | None:
    """The film that a node's parameters ask for; None: none.

    Args:
        parameter: gives the value of one of `FILM_PARAMETERS`.

    Raises:
        ObeliskConfigError: there is no such film.
    """
    path, camera, size, rate_hz = map(parameter, FILM_PARAMETERS)
    if not path:
        return None
    try:
        return read_film(path, camera, size, rate_hz)
    except FilmError as error:
        raise ObeliskConfigError(f"the film that `render` asks for: {error}") from error


def film_outputs(
    simulation: Simulation,
    settings: FilmSettings | None,
    *,
    tell: Tell,
    on_close: Callable[[Callable[[], None]], object],
) -> tuple[Output, ...]:
    """Begin a film; the output that hands it the states.

    Args:
        simulation: what is filmed.
        settings: the film; None: none.
        tell: takes what is to be known of it; called on a thread of its own.
        on_close: takes what has to be called when the simulation is freed.

    Raises:
        ObeliskConfigError: the camera is not there, or nothing can be drawn.
    """
    if settings is None:
        return ()
    order = film_order(simulation.model, settings)
    film = _Film(order, simulation, tell)
    on_close(film.close)

    def publish(_stamp: Any) -> None:
        film.send()

    times = SampleTimes(period_s=1 / order.rate_hz, step_s=simulation.step_s)
    # The start of a run is seen too.
    return (Output(times=times, publish=publish, restart=film.send),)


def film_order(model: mujoco.MjModel, settings: FilmSettings) -> FilmOrder:
    """What the process is to draw of a model.

    Raises:
        ObeliskConfigError: the camera is not there, or its pictures are of no fitting size.
    """
    camera = None if settings.camera is None else _camera(model, settings.camera)
    size = settings.size or picture_size(model, camera)
    try:
        check_film_size(settings.path.suffix, size)
    except FilmError as error:
        raise ObeliskConfigError(
            f"camera `{settings.camera}`: {error}; set `render_size`"
        ) from error
    # Between two steps there is nothing to see.
    steps_hz = int(1 / model.opt.timestep + 1e-6)
    return FilmOrder(
        path=str(Path.cwd() / settings.path),
        camera=camera,
        width=size[0],
        height=size[1],
        rate_hz=max(1, min(settings.rate_hz, steps_hz)),
    )


def _camera(model: mujoco.MjModel, name: str) -> int:
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name)
    if number < 0:
        names = [model.camera(other).name for other in range(model.ncam)]
        hint = did_you_mean(name, filter(None, names)) or "it has none"
        raise ObeliskConfigError(f"the camera `{name}` is not in the model; {hint}")
    return int(number)


class _Film:
    """The process that makes a film."""

    def __init__(self, order: FilmOrder, simulation: Simulation, tell: Tell) -> None:
        """Start it, and wait until it is sure that it can draw.

        Raises:
            ObeliskConfigError: it cannot; the sentence is its own.
        """
        self._tell = tell
        self._first = Future[tuple[Severity, str]]()
        self._is_told = False
        """Whether it is known what has become of the film."""
        self._onlooker = Onlooker(
            "film",
            order.to_arguments(),
            simulation.model,
            simulation.data,
            tell=self._hear,
            end_s=_END_S,
            loss=_LOSS,
        )
        self.send = self._onlooker.states.send
        # A film has a first picture, whatever comes after it.
        self.send()
        try:
            severity, text = self._first.result(_OPEN_S)
        except TimeoutError:
            severity, text = "warning", f"the film has not begun after {_OPEN_S:g} s"
        if severity == "warning":
            self._onlooker.close()
            raise ObeliskConfigError(text)
        tell(severity, text)

    def close(self) -> None:
        """Have it finish the film with the state that was reached last."""
        self.send()
        self._onlooker.close()
        if not self._is_told:
            self._tell("warning", f"{_LOSS}: it was not finished")

    def _hear(self, severity: Severity, text: str) -> None:
        if not self._first.done():
            self._first.set_result((severity, text))
            return
        self._is_told |= text.startswith(_FILM) or _LOSS in text
        self._tell(severity, text)
