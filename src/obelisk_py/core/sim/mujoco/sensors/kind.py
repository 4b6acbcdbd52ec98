"""Read the sensors of a group, and define the kinds of sensor groups.

In: a model, its data, the names of a group's sensors. Out: views of MuJoCo's own sensor memory and
names of frames, found once, so that a sample costs no look-up and makes no message.
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
"""Name of the frame that is fixed."""

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
    """Takes samples of the present state."""

    message: PackedMessage | None
    """What a sample is taken into; None: a sample is delivered when it is ready."""
    take: Callable[[], None]
    """Takes a sample."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorSource:
    """The sensors of one group, in the order of the config.

    A group that was checked against the model has the sensors that are asked for here.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    names: Mapping[str, str]
    """Sensor name -> MuJoCo sensor type, `joint_pos: jointpos`."""
    warn: Callable[[str], None]
    """Called with a warning about a group that can be published."""
    rays: RayCaster | None
    """The group's ray caster, if it has one."""
    deliver: Callable[[Any], None]
    """Called with a message that a sampler finishes later; on any thread."""
    on_close: Callable[[Callable[[], None]], object]
    """Registers a function to call when the simulation is freed."""
    is_paced: bool
    """Whether steps have deadlines; otherwise the simulation may wait for slow samples."""
    is_lockstep: bool = False
    """Whether the simulation has to wait for them."""

    def of_type(self, sensor_type: str) -> tuple[str, ...]:
        """Names of the group's sensors of one type."""
        return tuple(name for name, its_type in self.names.items() if its_type == sensor_type)

    def first(self, sensor_type: str) -> str | None:
        """The first of the group's sensors of one type, None if it has none."""
        return next(iter(self.of_type(sensor_type)), None)

    def view(self, sensor: str) -> Array:
        """MuJoCo's memory of a sensor's values, shape `(dim,)`; changes with each step."""
        number = self.model.sensor(sensor).id
        start = int(self.model.sensor_adr[number])
        values: Array = self.data.sensordata[start : start + int(self.model.sensor_dim[number])]
        return values

    def addresses(self, sensor: str) -> NDArray[np.intp]:
        """Places of a sensor's values in MuJoCo's `sensordata`."""
        number = self.model.sensor(sensor).id
        start = int(self.model.sensor_adr[number])
        return np.arange(start, start + int(self.model.sensor_dim[number]), dtype=np.intp)

    def object(self, sensor: str) -> tuple[int, int]:
        """Type and number of the object that a sensor is attached to."""
        number = self.model.sensor(sensor).id
        return int(self.model.sensor_objtype[number]), int(self.model.sensor_objid[number])

    def frame(self, sensor: str) -> str:
        """Name of the object that a sensor is attached to."""
        return self._name(*self.object(sensor))

    def reference(self, sensor: str) -> str:
        """Name of the frame that a sensor's values are given in: its reference object or world."""
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
    """Makes the sampler; raises ObeliskConfigError where the model does not allow it."""


Copy = Callable[[], None]


class Block(NamedTuple):
    """Numbers that lie side by side in a message and in MuJoCo's memory, both of shape `(n,)`."""

    numbers: NDArray[Any]
    source: Array


def copy_blocks(blocks: Iterable[Block]) -> Copy:
    """Copies blocks, in one call for all of them."""
    pairs: tuple[tuple[Any, Any], ...] = tuple(blocks)
    # Memory views take a third of the time of numpy, which also converts.
    if all(numbers.dtype == source.dtype for numbers, source in pairs):
        pairs = tuple((memoryview(numbers), memoryview(source)) for numbers, source in pairs)

    def copy() -> None:
        for numbers, source in pairs:
            numbers[:] = source

    return copy


def copy_all(numbers: NDArray[Any], source: Array) -> Copy:
    """Copies an array, shape `(n,)`."""
    return copy_blocks(vector_blocks(numbers, source))


def copy_picked(numbers: NDArray[Any], source: Array, index: NDArray[np.intp]) -> Copy:
    """Copies the elements of an array that an index, shape `(n,)`, picks."""
    if (np.diff(index) == 1).all():
        return copy_all(numbers, source[index[0] : index[-1] + 1])

    def copy() -> None:
        # The indices are valid; with "clip" numpy writes without a buffer of its own.
        source.take(index, out=numbers, mode="clip")

    return copy


def vector_blocks(numbers: NDArray[Any], source: Array) -> tuple[Block]:
    """A vector of MuJoCo's in a message."""
    return (Block(numbers, source),)


def quaternion_blocks(xyzw: NDArray[Any], wxyz: Array) -> tuple[Block, Block]:
    """A quaternion of MuJoCo's in a message."""
    return Block(xyzw[:3], wxyz[1:]), Block(xyzw[3:], wxyz[:1])


def in_turn(copies: Iterable[Copy]) -> Copy:
    """One call for several."""
    calls = tuple(copies)
    if len(calls) == 1:
        return calls[0]

    def copy() -> None:
        for call in calls:
            call()

    return copy


def set_quaternion(xyzw: NDArray[Any], wxyz: Array) -> None:
    """Put a quaternion of MuJoCo's into the numbers of a `geometry_msgs/Quaternion`."""
    xyzw[:3] = wxyz[1:]
    xyzw[3] = wxyz[0]
