"""Forces: `ObkForceSensor`.

In: `force` (three numbers, in the frame of its site) and `touch` (one number) sensors. `forces` has
their numbers one after another in the order of the config, `frames` their sites in the same order.
`header.frame_id` is the site where all sit at one, else empty: there is no frame of all.
"""

import numpy as np
from obelisk_sensor_msgs.msg import ObkForceSensor

from obelisk_py.core.serialization.codec import PackedMessage
from obelisk_py.core.sim.mujoco.sensors.fields import copy_picked
from obelisk_py.core.sim.mujoco.sensors.kind import Sampler, SensorKind, SensorSource

__all__ = ["FORCE"]


def _build(source: SensorSource) -> Sampler:
    index = np.concatenate([source.addresses(name) for name in source.names])
    frames = [source.frame(name) for name in source.names]
    message = ObkForceSensor(forces=np.zeros(len(index)), frames=frames)
    message.header.frame_id = frames[0] if len(set(frames)) == 1 else ""
    packed = PackedMessage(message)
    copy = copy_picked(packed.numbers("forces"), source.data.sensordata, index)
    return Sampler(message=packed, take=copy)


FORCE = SensorKind(message_type=ObkForceSensor, build=_build)
"""obelisk_sensor_msgs/ObkForceSensor."""
