"""Add sensor noise: `noise`, `dropout` and `delay` of a sensor group.

The inputs are a valid group's mapping, and its packed message with a new sample. Noise changes
numbers in this message, dropout discards messages, and delay holds them back. Noise on a vector is
added to each element, in the vector's unit. An orientation is rotated about its own axes, by angles
in radians. NaN stays NaN. The same seed yields the same messages in every run.
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
"""A number for all elements of a field, or one per axis; in the field's unit."""
_NEVER: Final = sys.maxsize
Array = NDArray[np.float64]
_Draw = Callable[[int], Array]
"""Returns the requested number of random values."""
_PLACES: Final[Mapping[str, Mapping[str, str]]] = {
    "PoseStamped": {"position": "pose.position", "orientation": "pose.orientation"},
    "Odometry": {
        "position": "pose.pose.position",
        "orientation": "pose.pose.orientation",
        "linear": "twist.twist.linear",
        "angular": "twist.twist.angular",
    },
}
"""`msg_type` -> field -> path in the message, for fields that are not at the top level."""
_AXES: Final = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldNoise:
    """Noise of one field: a normal distribution around a bias."""

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
    """Read the noise settings of a valid sensor group."""
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

    Noise on one field therefore does not affect another field, and runs are repeatable.
    """

    def __init__(self, *, seed: int, topic: str, purpose: str) -> None:
        """Start the stream."""
        self._source = np.random.SeedSequence(
            [seed, crc32(topic.encode()), crc32(purpose.encode())]
        )
        self.numbers = np.random.Generator(np.random.PCG64(self._source))
        """The stream at its current position."""

    def restart(self) -> None:
        """Restart the stream."""
        self.numbers = np.random.Generator(np.random.PCG64(self._source))


class Dropout:
    """Decides which messages are not published."""

    def __init__(self, probability: float, stream: RandomStream) -> None:
        """Drop messages with a probability from 0 to 1, drawn from `stream`."""
        self._probability = probability
        self._stream = stream

    def is_dropped(self) -> bool:
        """Whether the next message is dropped."""
        return bool(self._stream.numbers.random() < self._probability)

    def restart(self) -> None:
        """Restart the same sequence of decisions."""
        self._stream.restart()


class DelayLine:
    """Delays messages; also serves as an output's sample times: `next_step` is when one is due."""

    def __init__(self, *, delay_s: float, step_s: float) -> None:
        """Create an empty delay line.

        Args:
            delay_s: delay of a message [s], > 0.
            step_s: simulated time per step [s].
        """
        self._steps = whole_steps(delay_s, step_s)
        self._held: deque[tuple[int, Any]] = deque()

    @property
    def next_step(self) -> int:
        """The step after which the next message is due."""
        return self._held[0][0] if self._held else _NEVER

    def hold(self, message: Any, step: int) -> None:
        """Add a message that was sampled after `step`."""
        self._held.append((step + self._steps, message))

    def release(self) -> Any:
        """Remove and return the next message; fails if there is none."""
        return self._held.popleft()[1]

    def pass_step(self, step: int) -> None:
        """Do nothing: the delayed messages determine the next step."""

    def restart(self) -> None:
        """Drop all messages."""
        self._held.clear()


def field_place(msg_type: str, field: str) -> str:
    """Path of a noisy field in messages of a bare `msg_type`, such as `pose.position`."""
    return _PLACES.get(msg_type, {}).get(field, field)


class NoiseGenerator:
    """Adds the noise of one sensor group."""

    def __init__(
        self, msg_type: str, settings: SensorNoise, topic: str, message: PackedMessage
    ) -> None:
        """Locate the noisy fields of a bare `msg_type` in the message."""
        self._streams = []
        self._adders: list[Callable[[], None]] = []
        for field, noise in settings.noise.items():
            stream = RandomStream(seed=settings.seed, topic=topic, purpose=field)
            numbers = message.numbers(field_place(msg_type, field))
            draw = partial(_draw, noise, stream)
            self._streams.append(stream)
            self._adders.append(_adder(NOISY_FIELDS[msg_type][field], numbers, draw))

    def add(self) -> None:
        """Add noise to the message's numbers."""
        for add in self._adders:
            add()

    def restart(self) -> None:
        """Restart the same sequence of noise."""
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
            # Images store their 32-bit numbers as bytes.
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
