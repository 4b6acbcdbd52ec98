"""IMUs and force sensors: `ObkImu`, `sensor_msgs/Imu`, `ObkForceSensor`.

An IMU has at most one `accelerometer`, `gyro` and `framequat` each, all at the same site. This site
is the `header.frame_id`, in which accelerations and rates are given. If a part has no sensor, the
first element of its covariance is -1; other covariances are 0, which means unknown.

A force sensor has `force` sensors (three numbers, in the frame of the site) and `touch` sensors
(one number). `forces` contains their numbers in the order of the config, and `frames` their sites.
`header.frame_id` is the site if all sensors share one, otherwise empty.

Source: sensor_msgs/Imu.msg.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from sensor_msgs.msg import Imu

from obelisk_py.core.messages import optional_message
from obelisk_py.core.serialization.codec import PackedMessage
from obelisk_py.core.sim.mujoco.sensors.kind import (
    WORLD,
    Sampler,
    SensorKind,
    SensorSource,
    copy_blocks,
    copy_picked,
    quaternion_blocks,
    vector_blocks,
)

__all__ = ["FORCE", "IMU", "OBK_IMU"]

ObkForceSensor: Any = optional_message("ObkForceSensor")
ObkImu: Any = optional_message("ObkImu")
_PARTS = (
    ("accelerometer", "linear_acceleration", vector_blocks),
    ("gyro", "angular_velocity", vector_blocks),
    ("framequat", "orientation", quaternion_blocks),
)


def _imu_builder(message_type: type[Any]) -> Callable[[SensorSource], Sampler]:
    def build(source: SensorSource) -> Sampler:
        named = {kind: source.first(kind) for kind, _, _ in _PARTS}
        message = message_type()
        frames = [source.frame(sensor) for sensor in named.values() if sensor is not None]
        message.header.frame_id = next(iter(frames), WORLD)
        for kind, field, _ in _PARTS:
            if named[kind] is None:
                getattr(message, f"{field}_covariance")[0] = -1.0
        packed = PackedMessage(message)
        blocks = [
            block
            for kind, field, blocks_of in _PARTS
            if (sensor := named[kind]) is not None
            for block in blocks_of(packed.numbers(field), source.view(sensor))
        ]
        return Sampler(message=packed, take=copy_blocks(blocks))

    return build


OBK_IMU = SensorKind(message_type=ObkImu, build=_imu_builder(ObkImu))
"""obelisk_sensor_msgs/ObkImu."""

IMU = SensorKind(message_type=Imu, build=_imu_builder(Imu))
"""sensor_msgs/Imu."""


def _build_force(source: SensorSource) -> Sampler:
    index = np.concatenate([source.addresses(name) for name in source.names])
    frames = [source.frame(name) for name in source.names]
    message = ObkForceSensor(forces=np.zeros(len(index)), frames=frames)
    message.header.frame_id = frames[0] if len(set(frames)) == 1 else ""
    packed = PackedMessage(message)
    copy = copy_picked(packed.numbers("forces"), source.data.sensordata, index)
    return Sampler(message=packed, take=copy)


FORCE = SensorKind(message_type=ObkForceSensor, build=_build_force)
"""obelisk_sensor_msgs/ObkForceSensor."""
