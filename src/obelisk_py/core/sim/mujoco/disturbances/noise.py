"""Noise added to the fields of a message.

In: the packed message of a sensor group, with a new sample. Out: other numbers in it. A vector
gets its noise element by element, in its unit; an orientation is turned about its own axes, by
angles in radians; what is NaN stays so.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final, assert_never

import mujoco
import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.serialization.codec import PackedMessage
from obelisk_py.core.sim.mujoco.disturbances.chance import Chance
from obelisk_py.core.sim.mujoco.disturbances.settings import Disturbances, FieldNoise
from obelisk_py.core.sim.mujoco.sensors.fields import set_quaternion
from obelisk_spec.sensors import NOISY_FIELDS, FieldKind

__all__ = ["Noise", "field_place"]

Array = NDArray[np.float64]
_Draw = Callable[[int], Array]
"""Makes so many random numbers."""

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

    def __init__(
        self, msg_type: str, settings: Disturbances, topic: str, message: PackedMessage
    ) -> None:
        """Find the fields of a bare `msg_type` in the message."""
        self._chances = []
        self._adders: list[Callable[[], None]] = []
        for field, noise in settings.noise.items():
            chance = Chance(seed=settings.seed, topic=topic, purpose=field)
            numbers = message.numbers(field_place(msg_type, field))
            draw = partial(_draw, noise, chance)
            self._chances.append(chance)
            self._adders.append(_adder(NOISY_FIELDS[msg_type][field], numbers, draw))

    def add(self) -> None:
        """Change the message's numbers."""
        for add in self._adders:
            add()

    def restart(self) -> None:
        """Begin the same noise anew."""
        for chance in self._chances:
            chance.restart()


def _draw(noise: FieldNoise, chance: Chance, count: int) -> Array:
    values = chance.numbers.standard_normal(count)
    values *= noise.sigma
    values += noise.bias
    return values


def _adder(kind: FieldKind, numbers: NDArray[Any], draw: _Draw) -> Callable[[], None]:
    match kind:
        case "vector":
            return partial(_add_to_numbers, numbers, draw)
        case "rotation":
            return partial(_turn, numbers, draw)
        case "array":
            # Clouds and images hold their 32-bit numbers as bytes.
            is_raw = numbers.dtype == np.uint8
            return partial(_add_to_numbers, numbers.view(np.float32) if is_raw else numbers, draw)
    assert_never(kind)


def _add_to_numbers(numbers: NDArray[Any], draw: _Draw) -> None:
    numbers[:] = numbers + draw(len(numbers))


def _turn(xyzw: Array, draw: _Draw) -> None:
    wxyz = xyzw[[3, 0, 1, 2]]
    mujoco.mju_quatIntegrate(wxyz, draw(_AXES), 1.0)
    set_quaternion(xyzw, wxyz)
