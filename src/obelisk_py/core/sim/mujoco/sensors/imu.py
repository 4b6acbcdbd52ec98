"""Inertial measurement units: `ObkImu` and `sensor_msgs/Imu`.

In: at most one each of `accelerometer`, `gyro`, `framequat`, all at one site. `header.frame_id` is
that site: accelerations and rates are given in it, as the message asks. A part without a sensor is
marked by -1 as the first element of its covariance; the others are 0, which means unknown.

Source: sensor_msgs/Imu.msg.
"""

from collections.abc import Callable
from typing import Any

from obelisk_sensor_msgs.msg import ObkImu
from sensor_msgs.msg import Imu

from obelisk_py.core.serialization.codec import PackedMessage
from obelisk_py.core.sim.mujoco.sensors.fields import copy_all, copy_quaternion, in_turn
from obelisk_py.core.sim.mujoco.sensors.kind import WORLD, Sampler, SensorKind, SensorSource

__all__ = ["IMU", "OBK_IMU"]

_PARTS = (
    ("accelerometer", "linear_acceleration", copy_all),
    ("gyro", "angular_velocity", copy_all),
    ("framequat", "orientation", copy_quaternion),
)


def _builder(message_type: type[Any]) -> Callable[[SensorSource], Sampler]:
    def build(source: SensorSource) -> Sampler:
        named = {kind: source.first(kind) for kind, _, _ in _PARTS}
        message = message_type()
        frames = [source.frame(sensor) for sensor in named.values() if sensor is not None]
        message.header.frame_id = next(iter(frames), WORLD)
        for kind, field, _ in _PARTS:
            if named[kind] is None:
                getattr(message, f"{field}_covariance")[0] = -1.0
        packed = PackedMessage(message)
        copies = [
            copy(packed.numbers(field), source.view(sensor))
            for kind, field, copy in _PARTS
            if (sensor := named[kind]) is not None
        ]
        return Sampler(message=packed, take=in_turn(copies))

    return build


OBK_IMU = SensorKind(message_type=ObkImu, build=_builder(ObkImu))
"""obelisk_sensor_msgs/ObkImu."""

IMU = SensorKind(message_type=Imu, build=_builder(Imu))
"""sensor_msgs/Imu."""
