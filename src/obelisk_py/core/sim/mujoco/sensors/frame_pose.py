"""Pose of a frame: `ObkFramePose` and `geometry_msgs/PoseStamped`.

In: one `framepos` and one `framequat` of one object. `header.frame_id` is the reference object of
the position, or `world`. An orientation that the model gives in another frame is passed on as it
is, with a warning at configure.
"""

from typing import Any

from geometry_msgs.msg import PoseStamped
from obelisk_sensor_msgs.msg import ObkFramePose

from obelisk_py.core.serialization.codec import PackedMessage
from obelisk_py.core.sim.mujoco.sensors.fields import copy_all, copy_quaternion, in_turn
from obelisk_py.core.sim.mujoco.sensors.kind import Sampler, SensorKind, SensorSource

__all__ = ["FRAME_POSE", "POSE_STAMPED", "pose_reference"]


def pose_reference(source: SensorSource, position: str, orientation: str) -> str:
    """The frame that a pose is given in: the position's; warns where the orientation's differs."""
    of_position, of_orientation = source.reference(position), source.reference(orientation)
    if of_position != of_orientation:
        source.warn(
            f"the sensor `{position}` is given in the frame `{of_position}` and `{orientation}` in "
            f"`{of_orientation}`; the message says `{of_position}`. One `reftype` and "
            "`refname` for both in the model would make it a pose"
        )
    return of_position


def _build_obk(source: SensorSource) -> Sampler:
    return _sampler(source, ObkFramePose(frame_name=source.frame(_sensors(source)[0])), "")


def _build_stamped(source: SensorSource) -> Sampler:
    return _sampler(source, PoseStamped(), "pose.")


def _sensors(source: SensorSource) -> tuple[str, str]:
    return source.of_type("framepos")[0], source.of_type("framequat")[0]


def _sampler(source: SensorSource, message: Any, place: str) -> Sampler:
    """Takes the pose into the fields `position` and `orientation` behind `place`."""
    position, orientation = _sensors(source)
    message.header.frame_id = pose_reference(source, position, orientation)
    packed = PackedMessage(message)
    copies = (
        copy_all(packed.numbers(f"{place}position"), source.view(position)),
        copy_quaternion(packed.numbers(f"{place}orientation"), source.view(orientation)),
    )
    return Sampler(message=packed, take=in_turn(copies))


FRAME_POSE = SensorKind(message_type=ObkFramePose, build=_build_obk)
"""obelisk_sensor_msgs/ObkFramePose; `frame_name` is the object whose pose it is."""

POSE_STAMPED = SensorKind(message_type=PoseStamped, build=_build_stamped)
"""geometry_msgs/PoseStamped."""
