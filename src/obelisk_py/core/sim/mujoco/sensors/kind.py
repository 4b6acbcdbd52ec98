"""Read the sensors of a group, and define the kinds of sensor groups.

The inputs are a model, its data, and the names of a group's sensors. The outputs are views of
MuJoCo's sensor memory and names of frames. They are looked up once, so a sample costs no look-up
and creates no message.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.serialization.codec import PackedMessage
from obelisk_py.core.sim.mujoco.raycast import RayCaster

__all__ = [
    "WORLD",
    "Array",
    "Block",
    "Copy",
    "Sampler",
    "SensorKind",
    "SensorSource",
    "copy_all",
    "copy_blocks",
    "copy_picked",
    "in_turn",
    "quaternion_blocks",
    "set_quaternion",
    "vector_blocks",
]

Array = NDArray[np.float64]

WORLD: Final = "world"
"""Name of the fixed frame."""

_NAMED_OBJECTS: Final = {
    int(mujoco.mjtObj.mjOBJ_BODY),
    int(mujoco.mjtObj.mjOBJ_XBODY),
    int(mujoco.mjtObj.mjOBJ_GEOM),
    int(mujoco.mjtObj.mjOBJ_SITE),
    int(mujoco.mjtObj.mjOBJ_CAMERA),
}
"""Types of objects that are frames."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sampler:
    """Takes samples of the current state."""

    message: PackedMessage | None
    """The message that a sample is written to; None if samples are delivered when ready."""
    take: Callable[[], None]
    """Takes a sample."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorSource:
    """The sensors of one group, in the order of the config.

    The group must have been checked against the model, so that its sensors exist.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    names: Mapping[str, str]
    """Sensor name -> MuJoCo sensor type, `joint_pos: jointpos`."""
    warn: Callable[[str], None]
    """Logs a warning about a group that can still be published."""
    rays: RayCaster | None
    """The group's ray caster, if any."""
    deliver: Callable[[Any], None]
    """Publishes a message that a sampler finishes later; may be called on any thread."""
    on_close: Callable[[Callable[[], None]], object]
    """Registers a function to call when the simulation is closed."""
    is_paced: bool
    """Whether steps have deadlines; otherwise the simulation may wait for slow samples."""
    is_lockstep: bool = False
    """Whether the simulation must wait for slow samples."""

    def of_type(self, sensor_type: str) -> tuple[str, ...]:
        """Names of the group's sensors of one type."""
        return tuple(name for name, its_type in self.names.items() if its_type == sensor_type)

    def first(self, sensor_type: str) -> str | None:
        """The group's first sensor of one type; None if there is none."""
        return next(iter(self.of_type(sensor_type)), None)

    def view(self, sensor: str) -> Array:
        """A view of a sensor's values in MuJoCo's memory, shape `(dim,)`; each step updates it."""
        number = self.model.sensor(sensor).id
        start = int(self.model.sensor_adr[number])
        values: Array = self.data.sensordata[start : start + int(self.model.sensor_dim[number])]
        return values

    def addresses(self, sensor: str) -> NDArray[np.intp]:
        """Indices of a sensor's values in MuJoCo's `sensordata`."""
        number = self.model.sensor(sensor).id
        start = int(self.model.sensor_adr[number])
        return np.arange(start, start + int(self.model.sensor_dim[number]), dtype=np.intp)

    def object(self, sensor: str) -> tuple[int, int]:
        """Type and id of the object that a sensor is attached to."""
        number = self.model.sensor(sensor).id
        return int(self.model.sensor_objtype[number]), int(self.model.sensor_objid[number])

    def frame(self, sensor: str) -> str:
        """Name of the object that a sensor is attached to."""
        return self._name(*self.object(sensor))

    def reference(self, sensor: str) -> str:
        """Name of the frame of a sensor's values: its reference object or world."""
        number = self.model.sensor(sensor).id
        if int(self.model.sensor_refid[number]) < 0:
            return WORLD
        return self._name(
            int(self.model.sensor_reftype[number]), int(self.model.sensor_refid[number])
        )

    def _name(self, object_type: int, number: int) -> str:
        if object_type not in _NAMED_OBJECTS:
            return WORLD
        return mujoco.mj_id2name(self.model, object_type, number) or WORLD


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorKind:
    """One `msg_type` of a sensor group."""

    message_type: type[Any]
    build: Callable[[SensorSource], Sampler]
    """Creates the sampler; raises ObeliskConfigError if the model does not support it."""


Copy = Callable[[], None]


class Block(NamedTuple):
    """Contiguous numbers in a message and in MuJoCo's memory, both of shape `(n,)`."""

    numbers: NDArray[Any]
    source: Array


def copy_blocks(blocks: Iterable[Block]) -> Copy:
    """Return a function that copies all blocks."""
    pairs: tuple[tuple[Any, Any], ...] = tuple(blocks)
    # Memory views take a third of the time of numpy arrays, which also convert types.
    if all(numbers.dtype == source.dtype for numbers, source in pairs):
        pairs = tuple((memoryview(numbers), memoryview(source)) for numbers, source in pairs)

    def copy() -> None:
        for numbers, source in pairs:
            numbers[:] = source

    return copy


def copy_all(numbers: NDArray[Any], source: Array) -> Copy:
    """Return a function that copies an array, shape `(n,)`."""
    return copy_blocks(vector_blocks(numbers, source))


def copy_picked(numbers: NDArray[Any], source: Array, index: NDArray[np.intp]) -> Copy:
    """Return a function that copies the elements at an index, shape `(n,)`."""
    if (np.diff(index) == 1).all():
        return copy_all(numbers, source[index[0] : index[-1] + 1])

    def copy() -> None:
        # The indices are valid; with "clip", numpy needs no temporary buffer.
        source.take(index, out=numbers, mode="clip")

    return copy


def vector_blocks(numbers: NDArray[Any], source: Array) -> tuple[Block]:
    """Return the block that copies a MuJoCo vector to a message."""
    return (Block(numbers, source),)


def quaternion_blocks(xyzw: NDArray[Any], wxyz: Array) -> tuple[Block, Block]:
    """Return the blocks that copy a MuJoCo quaternion to a message."""
    return Block(xyzw[:3], wxyz[1:]), Block(xyzw[3:], wxyz[:1])


def in_turn(copies: Iterable[Copy]) -> Copy:
    """Combine several functions into one."""
    calls = tuple(copies)
    if len(calls) == 1:
        return calls[0]

    def copy() -> None:
        for call in calls:
            call()

    return copy


def set_quaternion(xyzw: NDArray[Any], wxyz: Array) -> None:
    """Write a MuJoCo quaternion to the numbers of a `geometry_msgs/Quaternion`."""
    xyzw[:3] = wxyz[1:]
    xyzw[3] = wxyz[0]
