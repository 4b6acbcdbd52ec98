"""Joint encoders: `ObkJointEncoders`, and the plain `JointEncoders`.

The inputs are `jointpos` and `jointvel` sensors on hinge and slide joints. Joints are ordered by
the first of their sensors in the config.

If a group has no velocity sensors at all, `joint_vel` is empty; likewise `joint_pos`. If only some
joints have both sensors, the missing numbers are read from the simulation's state. So the arrays
are as long as `joint_names`, and no placeholder can be mistaken for a measurement.
"""

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.messages import optional_message
from obelisk_py.core.serialization.codec import PackedMessage
from obelisk_py.core.sim.mujoco.sensors.kind import (
    WORLD,
    Copy,
    Sampler,
    SensorKind,
    SensorSource,
    copy_picked,
    in_turn,
)

__all__ = ["JOINT_ENCODERS", "OBK_JOINT_ENCODERS"]

JointEncoders: Any = optional_message("JointEncoders")
ObkJointEncoders: Any = optional_message("ObkJointEncoders")
_FIELDS: Final[Mapping[str, str]] = MappingProxyType(
    {"jointpos": "joint_pos", "jointvel": "joint_vel"}
)
"""Sensor type -> field of the message."""


def _build_obk(source: SensorSource) -> Sampler:
    joints = _joints(source)
    message = ObkJointEncoders(joint_names=[source.model.joint(joint).name for joint in joints])
    message.header.frame_id = WORLD
    kinds = [kind for kind in _FIELDS if source.of_type(kind)]
    for kind in kinds:
        setattr(message, _FIELDS[kind], np.zeros(len(joints)))
    packed = PackedMessage(message)
    copies = [_copy(source, joints, kind, packed.numbers(_FIELDS[kind])) for kind in kinds]
    return Sampler(message=packed, take=in_turn(copies))


def _build_plain(source: SensorSource) -> Sampler:
    index = _addresses(source, (*source.of_type("jointpos"), *source.of_type("jointvel")))
    message = JointEncoders(y=np.zeros(len(index)))
    message.header.frame_id = WORLD
    packed = PackedMessage(message)
    copy = copy_picked(packed.numbers("y"), source.data.sensordata, index)
    return Sampler(message=packed, take=copy)


def _joints(source: SensorSource) -> tuple[int, ...]:
    """Return the ids of the group's joints, in the order in which they are first named."""
    return tuple(dict.fromkeys(source.object(name)[1] for name in source.names))


def _copy(
    source: SensorSource, joints: Sequence[int], sensor_type: str, numbers: NDArray[Any]
) -> Copy:
    """Copy one number per joint: its sensor's value, or the state's if it has no sensor."""
    sensors = {source.object(name)[1]: name for name in source.of_type(sensor_type)}
    values = source.data.sensordata
    index = _addresses(source, [sensors[joint] for joint in joints if joint in sensors])
    measured = np.array([joint in sensors for joint in joints])
    if measured.all():
        return copy_picked(numbers, values, index)
    model, data = source.model, source.data
    state, address = {
        "jointpos": (data.qpos, model.jnt_qposadr),
        "jointvel": (data.qvel, model.jnt_dofadr),
    }[sensor_type]
    state_index = address[[joint for joint in joints if joint not in sensors]].astype(np.intp)

    def copy() -> None:
        numbers[measured] = values[index]
        numbers[~measured] = state[state_index]

    return copy


def _addresses(source: SensorSource, sensors: Iterable[str]) -> NDArray[np.intp]:
    return np.concatenate([source.addresses(sensor) for sensor in sensors])


OBK_JOINT_ENCODERS = SensorKind(message_type=ObkJointEncoders, build=_build_obk)
"""Positions, velocities and names."""

JOINT_ENCODERS = SensorKind(message_type=JointEncoders, build=_build_plain)
"""`y`: first the positions, then the velocities, each in the order of the config."""
