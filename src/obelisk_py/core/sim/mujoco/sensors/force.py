"""Forces: `ObkForceSensor`.

In: `force` (three numbers, in the frame of its site) and `touch` (one number) sensors. `forces` has
their numbers one after another in the order of the config, `frames` their sites in the same order.
`header.frame_id` is the site where all sit at one, else empty: there is no frame of all.
"""

import numpy as np
from builtin_interfaces.msg import Time
from obelisk_sensor_msgs.msg import ObkForceSensor

from obelisk_py.core.sim.mujoco.sensors.fields import doubles
from obelisk_py.core.sim.mujoco.sensors.kind import Sampler, SensorKind, SensorSource

__all__ = ["FORCE"]


def _build(source: SensorSource) -> Sampler:
    values = source.data.sensordata
    index = np.concatenate([source.addresses(name) for name in source.names])
    frames = [source.frame(name) for name in source.names]
    frame = frames[0] if len(set(frames)) == 1 else ""

    def sample(stamp: Time) -> ObkForceSensor:
        message = ObkForceSensor()
        message.header.stamp = stamp
        message.header.frame_id = frame
        message.forces = doubles(values[index])
        message.frames = frames
        return message

    return sample


FORCE = SensorKind(message_type=ObkForceSensor, build=_build)
"""obelisk_sensor_msgs/ObkForceSensor."""
