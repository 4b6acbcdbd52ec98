"""Pose of a frame: `ObkFramePose` and `geometry_msgs/PoseStamped`.

In: one `framepos` and one `framequat` of one object. `header.frame_id` is the reference object of
the position, or `world`. An orientation that the model gives in another frame is passed on as it
is, with a warning at configure.
"""

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from obelisk_sensor_msgs.msg import ObkFramePose

from obelisk_py.core.sim.mujoco.sensors.fields import set_quaternion, set_xyz
from obelisk_py.core.sim.mujoco.sensors.kind import Array, Sampler, SensorKind, SensorSource

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


def _sensors(source: SensorSource) -> tuple[Array, Array, str, str]:
    position, orientation = source.of_type("framepos")[0], source.of_type("framequat")[0]
    reference = pose_reference(source, position, orientation)
    return source.view(position), source.view(orientation), reference, source.frame(position)


def _build_obk(source: SensorSource) -> Sampler:
    position, orientation, reference, frame = _sensors(source)

    def sample(stamp: Time) -> ObkFramePose:
        message = ObkFramePose()
        message.header.stamp = stamp
        message.header.frame_id = reference
        message.frame_name = frame
        set_xyz(message.position, position)
        set_quaternion(message.orientation, orientation)
        return message

    return sample


def _build_stamped(source: SensorSource) -> Sampler:
    position, orientation, reference, _ = _sensors(source)

    def sample(stamp: Time) -> PoseStamped:
        message = PoseStamped()
        message.header.stamp = stamp
        message.header.frame_id = reference
        set_xyz(message.pose.position, position)
        set_quaternion(message.pose.orientation, orientation)
        return message

    return sample


FRAME_POSE = SensorKind(message_type=ObkFramePose, build=_build_obk)
"""obelisk_sensor_msgs/ObkFramePose; `frame_name` is the object whose pose it is."""

POSE_STAMPED = SensorKind(message_type=PoseStamped, build=_build_stamped)
"""geometry_msgs/PoseStamped."""
