"""Sensor noise: `noise`, `dropout` and `delay` of a sensor group.

In: the mapping of a group that has no findings, its packed message with a new sample. Out: changed
numbers in that message, messages that are dropped, messages held back. A vector gets its noise
element by element, in its unit; an orientation is turned about its own axes, by angles in radians;
NaN stays NaN. The same seed gives the same messages in every run.
"""

import sys
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, assert_never
from zlib import crc32

import mujoco
import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.serialization.codec import PackedMessage
from obelisk_py.core.sim.mujoco.sensors.kind import set_quaternion
from obelisk_py.core.sim.mujoco.sensors.raycast import POINT_FIELDS
from obelisk_py.core.sim.mujoco.step_times import whole_steps
from obelisk_spec.sensors import NOISY_FIELDS, FieldKind

__all__ = [
    "Amount",
    "DelayLine",
    "Dropout",
    "FieldNoise",
    "NoiseGenerator",
    "RandomStream",
    "SensorNoise",
    "field_place",
    "typed_sensor_noise",
]

Amount = float | tuple[float, ...]
"""One number for all elements of a field, or one for each axis; in the field's own unit."""
_NEVER: Final = sys.maxsize
Array = NDArray[np.float64]
_Draw = Callable[[int], Array]
"""Returns a number of random numbers."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldNoise:
    """Noise of one field: normally distributed around a bias."""

    sigma: Amount
    bias: Amount


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorNoise:
    """Noise, dropout and delay of a group's messages."""

    noise: Mapping[str, FieldNoise]
    """Field -> its noise."""
    dropout: float
    """Probability that a message is not published."""
    delay_s: float
    """Simulation time from the sample to its message [s]."""
    seed: int


def typed_sensor_noise(group: Mapping[str, Any]) -> SensorNoise:
    """The values of a sensor group that has no findings."""
    noise = {
        field: FieldNoise(sigma=_amount(given.get("sigma")), bias=_amount(given.get("bias")))
        for field, given in (group.get("noise") or {}).items()
    }
    return SensorNoise(
        noise=noise,
        dropout=float(group.get("dropout") or 0.0),
        delay_s=float(group.get("delay") or 0.0),
        seed=group.get("seed") or 0,
    )


def _amount(value: Any) -> Amount:
    if isinstance(value, list | tuple):
        return tuple(float(each) for each in value)
    return float(value or 0.0)


class RandomStream:
    """Random numbers that depend only on seed, topic and purpose, and can be restarted.

    Noise on one field thus changes nothing in another, and a run can be repeated.
    """

    def __init__(self, *, seed: int, topic: str, purpose: str) -> None:
        """Start the stream."""
        self._source = np.random.SeedSequence(
            [seed, crc32(topic.encode()), crc32(purpose.encode())]
        )
        self.numbers = np.random.Generator(np.random.PCG64(self._source))
        """The stream, where it is."""

    def restart(self) -> None:
        """Restart the stream."""
        self.numbers = np.random.Generator(np.random.PCG64(self._source))


class Dropout:
    """Decides which messages are not published."""

    def __init__(self, probability: float, stream: RandomStream) -> None:
        """Decide by `stream`, with a probability from 0 to 1."""
        self._probability = probability
        self._stream = stream

    def is_dropped(self) -> bool:
        """Whether the next message is dropped."""
        return bool(self._stream.numbers.random() < self._probability)

    def restart(self) -> None:
        """Restart the same decisions."""
        self._stream.restart()


class DelayLine:
    """Delays messages; as the times of an output it gives the step of the next one."""

    def __init__(self, *, delay_s: float, step_s: float) -> None:
        """Make an empty delay line.

        Args:
            delay_s: delay of a message [s], > 0.
            step_s: simulation time of a step [s].
        """
        self._steps = whole_steps(delay_s, step_s)
        self._held: deque[tuple[int, Any]] = deque()

    @property
    def next_step(self) -> int:
        """The step after which the next message is due."""
        return self._held[0][0] if self._held else _NEVER

    def hold(self, message: Any, step: int) -> None:
        """Take a message that was sampled after `step`."""
        self._held.append((step + self._steps, message))

    def release(self) -> Any:
        """The message that is due next; there must be one."""
        return self._held.popleft()[1]

    def pass_step(self, step: int) -> None:
        """Does nothing: the delayed messages determine the next step."""

    def restart(self) -> None:
        """Forget all messages."""
        self._held.clear()


def field_place(msg_type: str, field: str) -> str:
    """Path of a noisy field of a bare `msg_type` in its message, such as `pose.position`."""
    return _PLACES.get(msg_type, {}).get(field, field)


class NoiseGenerator:
    """Adds the noise of one sensor group."""

    def __init__(
        self, msg_type: str, settings: SensorNoise, topic: str, message: PackedMessage
    ) -> None:
        """Find the fields of a bare `msg_type` in the message."""
        self._streams = []
        self._adders: list[Callable[[], None]] = []
        for field, noise in settings.noise.items():
            stream = RandomStream(seed=settings.seed, topic=topic, purpose=field)
            numbers = message.numbers(field_place(msg_type, field))
            draw = partial(_draw, noise, stream)
            self._streams.append(stream)
            self._adders.append(_adder(NOISY_FIELDS[msg_type][field], numbers, draw))

    def add(self) -> None:
        """Change the message's numbers."""
        for add in self._adders:
            add()

    def restart(self) -> None:
        """Restart the same noise."""
        for stream in self._streams:
            stream.restart()


def _draw(noise: FieldNoise, stream: RandomStream, count: int) -> Array:
    values = stream.numbers.standard_normal(count)
    values *= noise.sigma
    values += noise.bias
    return values


def _adder(kind: FieldKind, numbers: NDArray[Any], draw: _Draw) -> Callable[[], None]:
    match kind:
        case "vector":
            return partial(_add_to_numbers, numbers, draw)
        case "rotation":
            return partial(_turn, numbers, draw)
        case "points":
            points = numbers.view(np.float32).reshape(-1, len(POINT_FIELDS))[:, :_AXES]
            return partial(_add_to_points, points, draw)
        case "array":
            # Images hold their 32-bit numbers as bytes.
            is_raw = numbers.dtype == np.uint8
            return partial(_add_to_numbers, numbers.view(np.float32) if is_raw else numbers, draw)
    assert_never(kind)


def _add_to_numbers(numbers: NDArray[Any], draw: _Draw) -> None:
    numbers[:] = numbers + draw(len(numbers))


def _add_to_points(points: NDArray[Any], draw: _Draw) -> None:
    points[:] = points + draw(points.size).reshape(points.shape)


def _turn(xyzw: Array, draw: _Draw) -> None:
    wxyz = xyzw[[3, 0, 1, 2]]
    mujoco.mju_quatIntegrate(wxyz, draw(_AXES), 1.0)
    set_quaternion(xyzw, wxyz)
