"""Ray casters: `ObkScan`, `PointCloud2`, `DepthImage`.

In: the group's ray caster. A ray without a hit is NaN in all of them. `header.frame_id` is the
`frame` of the config, otherwise the site; the points of a cloud are given in that frame.

Source: sensor_msgs/PointCloud2.msg; REP 118 (a depth image holds distances along the axis).
"""

import sys
from array import array
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from sensor_msgs.msg import Image, PointCloud2, PointField

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.messages import optional_message
from obelisk_py.core.serialization.codec import PackedMessage
from obelisk_py.core.sim.mujoco.raycast import DepthCamera, RayCaster, Scan, make_caster
from obelisk_py.core.sim.mujoco.sensors.kind import WORLD, Array, Sampler, SensorKind, SensorSource

__all__ = ["DEPTH_IMAGE", "OBK_SCAN", "POINT_CLOUD", "Frame", "find_frame"]

ObkScan: Any = optional_message("ObkScan")
_FLOAT_BYTES: Final = 4
_POINT_BYTES: Final = 3 * _FLOAT_BYTES


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """A frame that moves with the simulation."""

    position: Array
    """In the world [m], shape `(3,)`."""
    rotation: Array
    """From the frame to the world, shape `(3, 3)`."""


def find_frame(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> Frame | None:
    """The site, body, geom or camera of a name, the first that there is; None for the world.

    The model must have one of them; `obelisk_spec` checks that.
    """
    if name == WORLD:
        return None
    objects = mujoco.mjtObj
    for kind, positions, rotations in (
        (objects.mjOBJ_SITE, data.site_xpos, data.site_xmat),
        (objects.mjOBJ_BODY, data.xpos, data.xmat),
        (objects.mjOBJ_GEOM, data.geom_xpos, data.geom_xmat),
        (objects.mjOBJ_CAMERA, data.cam_xpos, data.cam_xmat),
    ):
        number = mujoco.mj_name2id(model, kind, name)
        if number >= 0:
            return Frame(position=positions[number], rotation=rotations[number].reshape(3, 3))
    return None


def _build_scan(source: SensorSource) -> Sampler:
    settings, scan = _scan(source)
    message = ObkScan(data=array("f", bytes(_FLOAT_BYTES * len(scan.distances))))
    message.header.frame_id = settings.frame or settings.site
    packed = PackedMessage(message)
    numbers = packed.numbers("data")

    def take() -> None:
        scan.cast()
        np.copyto(numbers, scan.distances, casting="same_kind")

    return Sampler(message=packed, take=take)


def _build_cloud(source: SensorSource) -> Sampler:
    settings, scan = _scan(source)
    name = settings.frame or settings.site
    frame = find_frame(source.model, source.data, name)
    rows, columns = scan.rays.rows, scan.rays.columns
    message = PointCloud2(
        height=rows,
        width=columns,
        fields=[
            PointField(name=axis, offset=place * _FLOAT_BYTES, datatype=PointField.FLOAT32, count=1)
            for place, axis in enumerate("xyz")
        ],
        is_bigendian=sys.byteorder == "big",
        point_step=_POINT_BYTES,
        row_step=_POINT_BYTES * columns,
        data=bytes(_POINT_BYTES * rows * columns),
    )
    message.header.frame_id = name
    packed = PackedMessage(message)
    numbers = packed.numbers("data").view(np.float32).reshape(-1, 3)
    points = np.empty((rows * columns, 3))

    def take() -> None:
        scan.cast()
        np.multiply(scan.directions, scan.distances[:, None], out=points)
        np.add(points, scan.starts, out=points)
        if frame is None:
            np.copyto(numbers, points, casting="same_kind")
        else:
            np.subtract(points, frame.position, out=points)
            np.copyto(numbers, points @ frame.rotation, casting="same_kind")

    return Sampler(message=packed, take=take)


def _build_image(source: SensorSource) -> Sampler:
    settings, scan = _scan(source)
    rows, columns = scan.rays.rows, scan.rays.columns
    message = Image(
        height=rows,
        width=columns,
        encoding="32FC1",
        is_bigendian=int(sys.byteorder == "big"),
        step=_FLOAT_BYTES * columns,
        data=bytes(_FLOAT_BYTES * rows * columns),
    )
    message.header.frame_id = settings.frame or settings.site
    packed = PackedMessage(message)
    numbers = packed.numbers("data").view(np.float32)
    is_camera = isinstance(settings.pattern, DepthCamera)
    # Of a unit vector, the x component is the part of a distance that lies along the axis.
    along_axis = scan.rays.directions[:, 0] if is_camera else np.ones(len(numbers))

    def take() -> None:
        scan.cast()
        np.multiply(scan.distances, along_axis, out=numbers, casting="same_kind")

    return Sampler(message=packed, take=take)


def _scan(source: SensorSource) -> tuple[RayCaster, Scan]:
    settings = source.rays
    if settings is None:
        raise ObeliskConfigError(
            "a sensor group that casts rays has neither `scan_config` nor `config_path`"
        )
    return settings, make_caster(source.model, source.data, settings)


OBK_SCAN = SensorKind(message_type=ObkScan, build=_build_scan)
"""obelisk_sensor_msgs/ObkScan: distances along the rays."""

POINT_CLOUD = SensorKind(message_type=PointCloud2, build=_build_cloud)
"""sensor_msgs/PointCloud2: x, y, z of the hits, in the order of the rays."""

DEPTH_IMAGE = SensorKind(message_type=Image, build=_build_image)
"""sensor_msgs/Image 32FC1: a depth camera's distances along its axis, a lidar's along its rays."""
