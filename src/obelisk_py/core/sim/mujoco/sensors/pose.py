"""Poses and odometry: `ObkFramePose`, `geometry_msgs/PoseStamped`, `nav_msgs/Odometry`.

The inputs are one `framepos` and one `framequat` of the same object; odometry also needs
`velocimeter` and `gyro`. The pose is given in `header.frame_id`, which is the reference object of
the position, or `world`. If the model gives the orientation in another frame, it is published
unchanged, with a warning in `configure`.

The twist of an odometry message is given in `child_frame_id`, the object. Velocimeter and gyro may
be at other sites of the object's body; their measurements are transformed to the object.
Covariances are 0, which means unknown.

Source: nav_msgs/Odometry.msg.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from numpy.typing import NDArray

from obelisk_py.core.messages import optional_message
from obelisk_py.core.serialization.codec import PackedMessage
from obelisk_py.core.sim.mujoco.sensors.kind import (
    WORLD,
    Array,
    Copy,
    Sampler,
    SensorKind,
    SensorSource,
    copy_all,
    copy_blocks,
    in_turn,
    quaternion_blocks,
    vector_blocks,
)

__all__ = ["FRAME_POSE", "ODOMETRY", "POSE_STAMPED", "pose_reference"]

ObkFramePose: Any = optional_message("ObkFramePose")


def pose_reference(source: SensorSource, position: str, orientation: str) -> str:
    """Return the frame of a pose: that of its position; warn if the orientation has another."""
    of_position, of_orientation = source.reference(position), source.reference(orientation)
    if of_position != of_orientation:
        source.warn(
            f"the sensor `{position}` is given in the frame `{of_position}`, but `{orientation}` "
            f"in `{of_orientation}`; the message uses `{of_position}`. Set the same `reftype` and "
            "`refname` for both in the model"
        )
    return of_position


def _build_obk(source: SensorSource) -> Sampler:
    return _sampler(source, ObkFramePose(frame_name=source.frame(_sensors(source)[0])), "")


def _build_stamped(source: SensorSource) -> Sampler:
    return _sampler(source, PoseStamped(), "pose.")


def _sensors(source: SensorSource) -> tuple[str, str]:
    return source.of_type("framepos")[0], source.of_type("framequat")[0]


def _sampler(source: SensorSource, message: Any, place: str) -> Sampler:
    """Sample the pose into the `position` and `orientation` fields under `place`."""
    position, orientation = _sensors(source)
    message.header.frame_id = pose_reference(source, position, orientation)
    packed = PackedMessage(message)
    blocks = (
        *vector_blocks(packed.numbers(f"{place}position"), source.view(position)),
        *quaternion_blocks(packed.numbers(f"{place}orientation"), source.view(orientation)),
    )
    return Sampler(message=packed, take=copy_blocks(blocks))


FRAME_POSE = SensorKind(message_type=ObkFramePose, build=_build_obk)
"""obelisk_sensor_msgs/ObkFramePose; `frame_name` is the object that has the pose."""

POSE_STAMPED = SensorKind(message_type=PoseStamped, build=_build_stamped)
"""geometry_msgs/PoseStamped."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Mount:
    """The pose of an object on its body."""

    body: int
    position: Array
    """In the body's frame [m], shape `(3,)`."""
    rotation: Array
    """From the object's frame to the body's, shape `(3, 3)`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Twist:
    """Constant matrices from velocities at the sensors to those of the object, in its own frame."""

    linear: Array | None
    """Velocimeter -> linear velocity, shape `(3, 3)`; None for the identity."""
    lever: Array | None
    """Gyro -> linear velocity, shape `(3, 3)`; None if velocimeter and object coincide."""
    angular: Array | None
    """Gyro -> angular velocity, shape `(3, 3)`; None for the identity."""


def _build_odometry(source: SensorSource) -> Sampler:
    position, orientation = source.first("framepos"), source.first("framequat")
    velocimeter, gyro = source.first("velocimeter"), source.first("gyro")
    pose_sensor = position or orientation
    frame = source.frame(pose_sensor) if pose_sensor else ""
    reference = source.reference(pose_sensor) if pose_sensor else WORLD
    if position and orientation:
        reference = pose_reference(source, position, orientation)
    message = Odometry(child_frame_id=frame)
    message.header.frame_id = reference
    packed = PackedMessage(message)
    blocks = [
        block
        for field, sensor, blocks_of in (
            ("pose.pose.position", position, vector_blocks),
            ("pose.pose.orientation", orientation, quaternion_blocks),
        )
        if sensor is not None
        for block in blocks_of(packed.numbers(field), source.view(sensor))
    ]
    copies = [copy_blocks(blocks)]
    copies += _twist_copies(source, packed, _twist(source, pose_sensor, velocimeter, gyro))
    return Sampler(message=packed, take=in_turn(copies))


def _twist_copies(source: SensorSource, message: PackedMessage, twist: _Twist) -> Iterator[Copy]:
    velocimeter, gyro = source.first("velocimeter"), source.first("gyro")
    speed = None if velocimeter is None else source.view(velocimeter)
    rate = None if gyro is None else source.view(gyro)
    linear = message.numbers("twist.twist.linear")
    angular = message.numbers("twist.twist.angular")
    if speed is not None:
        yield _turned(linear, twist.linear, speed)
        if twist.lever is not None and rate is not None:
            yield partial(_add_turned, linear, twist.lever, rate)
    if rate is not None:
        yield _turned(angular, twist.angular, rate)


def _turned(numbers: NDArray[Any], matrix: Array | None, source: Array) -> Copy:
    if matrix is None:
        return copy_all(numbers, source)
    return partial(np.matmul, matrix, source, numbers)


def _add_turned(numbers: NDArray[Any], matrix: Array, source: Array) -> None:
    numbers += matrix @ source


def _twist(
    source: SensorSource, pose: str | None, velocimeter: str | None, gyro: str | None
) -> _Twist:
    if pose is None:
        return _Twist(linear=None, lever=None, angular=None)
    target = _mount(source, pose)
    speed = _mount_on(source, target, velocimeter, pose)
    spin = _mount_on(source, target, gyro, pose)
    linear = np.eye(3) if speed is None else target.rotation.T @ speed.rotation
    angular = np.eye(3) if spin is None else target.rotation.T @ spin.rotation
    lever = np.zeros((3, 3))
    if speed is not None and spin is not None:
        arm = target.rotation.T @ (target.position - speed.position)
        lever = -_cross_matrix(arm) @ angular
    elif speed is not None and not np.allclose(target.position, speed.position):
        source.warn(
            f"the sensor `{velocimeter}` is not at the pose of `{source.frame(pose)}`. Without "
            "a `gyro` on that body, the linear velocity is that at the sensor"
        )
    return _Twist(
        linear=_unless(linear, np.eye(3)),
        lever=_unless(lever, np.zeros((3, 3))),
        angular=_unless(angular, np.eye(3)),
    )


def _mount_on(source: SensorSource, target: _Mount, sensor: str | None, pose: str) -> _Mount | None:
    """Return the mount of a sensor on the target's body; warn and return None if on another."""
    if sensor is None:
        return None
    mount = _mount(source, sensor)
    if mount.body == target.body:
        return mount
    source.warn(
        f"the sensor `{sensor}` and the pose of `{source.frame(pose)}` are on different bodies; "
        "its values are published unchanged"
    )
    return None


def _mount(source: SensorSource, sensor: str) -> _Mount:
    object_type, number = source.object(sensor)
    model = source.model
    tables = {
        int(mujoco.mjtObj.mjOBJ_BODY): (model.body_ipos, model.body_iquat, range(model.nbody)),
        int(mujoco.mjtObj.mjOBJ_SITE): (model.site_pos, model.site_quat, model.site_bodyid),
        int(mujoco.mjtObj.mjOBJ_GEOM): (model.geom_pos, model.geom_quat, model.geom_bodyid),
        int(mujoco.mjtObj.mjOBJ_CAMERA): (model.cam_pos, model.cam_quat, model.cam_bodyid),
    }
    if object_type not in tables:
        return _Mount(body=number, position=np.zeros(3), rotation=np.eye(3))
    positions, quaternions, bodies = tables[object_type]
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, quaternions[number])
    return _Mount(
        body=int(bodies[number]), position=positions[number], rotation=rotation.reshape(3, 3)
    )


def _cross_matrix(a: Array) -> Array:
    """Return the matrix of the cross product `a x`."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _unless(matrix: Array, trivial: Array) -> Array | None:
    """Return None for a matrix that changes nothing, so that numbers are copied unchanged."""
    return None if np.allclose(matrix, trivial, atol=1e-12) else matrix


ODOMETRY = SensorKind(message_type=Odometry, build=_build_odometry)
"""nav_msgs/Odometry."""
