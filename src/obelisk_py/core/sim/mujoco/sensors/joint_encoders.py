"""Joint encoders: `ObkJointEncoders`, and the plain `JointEncoders`.

In: `jointpos` and `jointvel` sensors on hinge and slide joints. Joints stand in the order in which
the config first names one of their sensors.

A group that measures no velocities at all leaves `joint_vel` empty, and likewise `joint_pos`. If
some joints have both sensors and others one, the missing numbers are the simulation's own: arrays
stay as long as `joint_names`, and no filler is taken for a measurement.
"""

from array import array
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from builtin_interfaces.msg import Time
from obelisk_sensor_msgs.msg import JointEncoders, ObkJointEncoders

from obelisk_py.core.sim.mujoco.sensors.fields import doubles
from obelisk_py.core.sim.mujoco.sensors.kind import (
    WORLD,
    Array,
    Sampler,
    SensorKind,
    SensorSource,
)

__all__ = ["JOINT_ENCODERS", "OBK_JOINT_ENCODERS"]

Reader = Callable[[], "array[float]"]


def _build_obk(source: SensorSource) -> Sampler:
    joints = _joints(source)
    names = [source.model.joint(joint).name for joint in joints]
    read_pos = _reader(source, joints, "jointpos", source.data.qpos, source.model.jnt_qposadr)
    read_vel = _reader(source, joints, "jointvel", source.data.qvel, source.model.jnt_dofadr)

    def sample(stamp: Time) -> ObkJointEncoders:
        message = ObkJointEncoders()
        message.header.stamp = stamp
        message.header.frame_id = WORLD
        message.stamp = stamp
        message.joint_pos = read_pos()
        message.joint_vel = read_vel()
        message.joint_names = names
        return message

    return sample


def _build_plain(source: SensorSource) -> Sampler:
    sensors = (*source.of_type("jointpos"), *source.of_type("jointvel"))
    values = source.data.sensordata
    index = np.array([_address(source, name) for name in sensors], dtype=np.intp)

    def sample(stamp: Time) -> JointEncoders:
        message = JointEncoders()
        message.header.stamp = stamp
        message.header.frame_id = WORLD
        message.y = doubles(values[index])
        return message

    return sample


def _joints(source: SensorSource) -> tuple[int, ...]:
    """Numbers of the group's joints, in the order in which they are first named."""
    return tuple(dict.fromkeys(source.object(name)[1] for name in source.names))


def _reader(
    source: SensorSource,
    joints: Sequence[int],
    sensor_type: str,
    state: Array,
    state_address: Mapping[int, int],
) -> Reader:
    """Reads one number per joint: its sensor's, or the state's where it has none."""
    sensors = {source.object(name)[1]: name for name in source.of_type(sensor_type)}
    if not sensors:
        return lambda: array("d")
    measured = np.array([joint in sensors for joint in joints])
    values = source.data.sensordata
    index = np.array([_address(source, sensors[j]) for j in joints if j in sensors], dtype=np.intp)
    if measured.all():
        return lambda: doubles(values[index])
    state_index = np.array([state_address[j] for j in joints if j not in sensors], dtype=np.intp)

    def read() -> "array[float]":
        both = np.empty(len(joints))
        both[measured] = values[index]
        both[~measured] = state[state_index]
        return doubles(both)

    return read


def _address(source: SensorSource, sensor: str) -> int:
    return int(source.model.sensor_adr[source.model.sensor(sensor).id])


OBK_JOINT_ENCODERS = SensorKind(message_type=ObkJointEncoders, build=_build_obk)
"""Positions, velocities and names."""

JOINT_ENCODERS = SensorKind(message_type=JointEncoders, build=_build_plain)
"""`y`: the positions in the order of the config, then the velocities in the order of the config."""
