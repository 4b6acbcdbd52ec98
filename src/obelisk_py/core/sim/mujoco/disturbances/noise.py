"""Noise added to the fields of a message.

In: a message of a sensor group, freshly made. Out: the same message with other numbers. A vector
gets its noise element by element, in its unit; an orientation is turned about its own axes, by
angles in radians; what is NaN stays so.
"""

from array import array
from collections.abc import Callable, Mapping
from functools import partial
from operator import attrgetter
from typing import Any, Final, assert_never

import mujoco
import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.sim.mujoco.disturbances.chance import Chance
from obelisk_py.core.sim.mujoco.disturbances.settings import Disturbances, FieldNoise
from obelisk_py.core.sim.mujoco.sensors.fields import set_quaternion, set_xyz
from obelisk_spec.disturbances import NOISY_FIELDS, FieldKind

__all__ = ["Noise", "field_place"]

Array = NDArray[np.float64]
_Add = Callable[[Any], None]

_PLACES: Final[Mapping[str, Mapping[str, str]]] = {
    "PoseStamped": {"position": "pose.position", "orientation": "pose.orientation"},
    "Odometry": {
        "position": "pose.pose.position",
        "orientation": "pose.pose.orientation",
        "linear": "twist.twist.linear",
        "angular": "twist.twist.angular",
    },
}
"""`msg_type` -> field -> where it is, for those that are not the message's own."""
_AXES: Final = 3


def field_place(msg_type: str, field: str) -> str:
    """Where a noisy field of a bare `msg_type` is in its message, `pose.position`."""
    return _PLACES.get(msg_type, {}).get(field, field)


class Noise:
    """Adds the noise of one sensor group."""

    def __init__(self, msg_type: str, settings: Disturbances, topic: str) -> None:
        """Find the fields of a bare `msg_type`."""
        self._chances = []
        self._adders: list[_Add] = []
        for field, noise in settings.noise.items():
            chance = Chance(seed=settings.seed, topic=topic, purpose=field)
            place = field_place(msg_type, field)
            draw = partial(_draw, noise, chance)
            self._chances.append(chance)
            self._adders.append(_adder(NOISY_FIELDS[msg_type][field], place, draw))

    def add(self, message: Any) -> None:
        """Change the message's numbers."""
        for add in self._adders:
            add(message)

    def restart(self) -> None:
        """Begin the same noise anew."""
        for chance in self._chances:
            chance.restart()


def _draw(noise: FieldNoise, chance: Chance, count: int) -> Array:
    values = chance.numbers.standard_normal(count)
    values *= noise.sigma
    values += noise.bias
    return values


def _adder(kind: FieldKind, place: str, draw: Callable[[int], Array]) -> _Add:
    match kind:
        case "vector":
            return partial(_add_to_vector, attrgetter(place), draw)
        case "rotation":
            return partial(_add_to_rotation, attrgetter(place), draw)
        case "array":
            return partial(_add_to_array, place, draw)
    assert_never(kind)


def _add_to_vector(get: Callable[[Any], Any], draw: Callable[[int], Array], message: Any) -> None:
    field = get(message)
    values = draw(_AXES)
    values += (field.x, field.y, field.z)
    set_xyz(field, values)


def _add_to_rotation(get: Callable[[Any], Any], draw: Callable[[int], Array], message: Any) -> None:
    field = get(message)
    wxyz = np.array((field.w, field.x, field.y, field.z))
    mujoco.mju_quatIntegrate(wxyz, draw(_AXES), 1.0)
    set_quaternion(field, wxyz)


def _add_to_array(place: str, draw: Callable[[int], Array], message: Any) -> None:
    held = getattr(message, place)
    # Clouds and images hold their 32-bit numbers as bytes.
    code = "f" if held.typecode == "B" else held.typecode
    values = np.frombuffer(held, dtype=code).astype(np.float64)
    values += draw(len(values))
    setattr(message, place, array(held.typecode, values.astype(code).tobytes()))
