"""Inertial measurement units: `ObkImu` and `sensor_msgs/Imu`.

In: at most one each of `accelerometer`, `gyro`, `framequat`, all at one site. `header.frame_id` is
that site: accelerations and rates are given in it, as the message asks. A part without a sensor is
marked by -1 as the first element of its covariance; the others are 0, which means unknown.

Source: sensor_msgs/Imu.msg.
"""

from collections.abc import Callable
from typing import Any

from builtin_interfaces.msg import Time
from obelisk_sensor_msgs.msg import ObkImu
from sensor_msgs.msg import Imu

from obelisk_py.core.sim.mujoco.sensors.fields import set_quaternion, set_xyz
from obelisk_py.core.sim.mujoco.sensors.kind import WORLD, Sampler, SensorKind, SensorSource

__all__ = ["IMU", "OBK_IMU"]

_PARTS = (
    ("accelerometer", "linear_acceleration", set_xyz),
    ("gyro", "angular_velocity", set_xyz),
    ("framequat", "orientation", set_quaternion),
)


def _builder(message_type: type[Any]) -> Callable[[SensorSource], Sampler]:
    def build(source: SensorSource) -> Sampler:
        named = {kind: source.first(kind) for kind, _, _ in _PARTS}
        parts = [
            (field, put, source.view(sensor))
            for kind, field, put in _PARTS
            if (sensor := named[kind]) is not None
        ]
        missing = [f"{field}_covariance" for kind, field, _ in _PARTS if named[kind] is None]
        frame = next((source.frame(sensor) for sensor in named.values() if sensor), WORLD)

        def sample(stamp: Time) -> Any:
            message = message_type()
            message.header.stamp = stamp
            message.header.frame_id = frame
            for field, put, values in parts:
                put(getattr(message, field), values)
            for covariance in missing:
                getattr(message, covariance)[0] = -1.0
            return message

        return sample

    return build


OBK_IMU = SensorKind(message_type=ObkImu, build=_builder(ObkImu))
"""obelisk_sensor_msgs/ObkImu."""

IMU = SensorKind(message_type=Imu, build=_builder(Imu))
"""sensor_msgs/Imu."""
