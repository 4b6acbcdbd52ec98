"""Sample sensor groups in the current state."""

import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message

from obelisk_py.core.sim.mujoco.sensors import SENSOR_KINDS, SensorSource

__all__ = ["STAMP", "group", "taken"]

STAMP = Time(sec=12, nanosec=34)
_STAMP_NS = 12_000_000_034


def group(model, data, kind, *, names=(), rays=None, warn=pytest.fail):
    """A sampler that publishes immediately."""
    source = SensorSource(
        model=model,
        data=data,
        names=dict(names),
        rays=rays,
        warn=warn,
        deliver=pytest.fail,
        on_close=pytest.fail,
        is_paced=False,
    )
    return SENSOR_KINDS[kind].build(source)


def taken(kind, sampler):
    """The message of the current state."""
    sampler.take()
    data = sampler.message.to_bytes(_STAMP_NS)
    message = deserialize_message(data, SENSOR_KINDS[kind].message_type)
    assert message.header.stamp == STAMP
    return message
