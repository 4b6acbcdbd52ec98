"""Ray casters: `ObkScan`, `PointCloud2`, `DepthImage`.

The input is the group's ray caster. A ray without a hit is NaN; a cloud omits it unless the config
keeps misses. `header.frame_id` is the config's `frame`, which is only a label: the points of a
cloud are given in the frame of the site, unless the config selects `frame`.

Source: sensor_msgs/PointCloud2.msg; REP 118 (a depth image contains distances along the axis).
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
from obelisk_py.core.sim.mujoco.raycast import DepthCamera, HeightScan, RayCaster, Scan, make_caster
from obelisk_py.core.sim.mujoco.sensors.kind import WORLD, Array, Sampler, SensorKind, SensorSource

__all__ = [
    "DEPTH_IMAGE",
    "OBK_SCAN",
    "POINT_CLOUD",
    "POINT_FIELDS",
    "CloudMessage",
    "Frame",
    "find_frame",
]

ObkScan: Any = optional_message("ObkScan")
_FLOAT_BYTES: Final = 4
POINT_FIELDS: Final = ("x", "y", "z", "intensity")
"""Fields of a point in a cloud, each a 32-bit float."""
_POINT_BYTES: Final = len(POINT_FIELDS) * _FLOAT_BYTES
_INTENSITY: Final = 1.0
"""Intensity of every point, because MuJoCo models have no reflectivity."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """A frame that moves with the simulation."""

    position: Array
    """Position in the world [m], shape `(3,)`."""
    rotation: Array
    """Rotation from the frame to the world, shape `(3, 3)`."""


def find_frame(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> Frame | None:
    """Return the first site, body, geom or camera with this name; None for the world.

    The model must have one of them; `obelisk_spec` checks this.
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
    message.header.frame_id = settings.frame
    packed = PackedMessage(message)
    numbers = packed.numbers("data")
    holds_height = isinstance(settings.pattern, HeightScan) and settings.pattern.holds_height

    def take() -> None:
        scan.cast()
        values = scan.distances
        if holds_height:
            values = scan.starts[:, 2] + scan.distances * scan.directions[:, 2]
        np.copyto(numbers, values, casting="same_kind")

    return Sampler(message=packed, take=take)


class CloudMessage(PackedMessage):
    """A `PointCloud2` of hits; their number changes from sample to sample."""

    def __init__(self, message: PointCloud2) -> None:
        """Pack an unorganized cloud with space for every ray."""
        super().__init__(message)
        self._width = self.numbers("width")
        self._row_step = self.numbers("row_step")

    def set_count(self, count: int) -> None:
        """Keep the first `count` points."""
        self._width[:] = count
        self._row_step[:] = count * _POINT_BYTES

    def to_bytes(self, stamp_ns: int) -> bytes:
        """Return the current bytes, without the unused space."""
        return self.to_bytes_with(stamp_ns, "data", int(self._row_step[0]))


def _build_cloud(source: SensorSource) -> Sampler:
    settings, scan = _scan(source)
    name = settings.frame if settings.points_in_frame else settings.site
    frame = find_frame(source.model, source.data, name)
    rows, columns, count = scan.rays.rows, scan.rays.columns, len(scan.distances)
    is_organised = settings.keeps_misses
    message = PointCloud2(
        height=rows if is_organised else 1,
        width=columns if is_organised else count,
        fields=[
            PointField(name=axis, offset=place * _FLOAT_BYTES, datatype=PointField.FLOAT32, count=1)
            for place, axis in enumerate(POINT_FIELDS)
        ],
        is_bigendian=sys.byteorder == "big",
        point_step=_POINT_BYTES,
        row_step=_POINT_BYTES * (columns if is_organised else count),
        data=bytes(_POINT_BYTES * count),
        is_dense=not is_organised,
    )
    message.header.frame_id = settings.frame
    packed = PackedMessage(message) if is_organised else CloudMessage(message)
    numbers = packed.numbers("data").view(np.float32).reshape(-1, len(POINT_FIELDS))
    numbers[:, 3] = _INTENSITY
    places, points = numbers[:, :3], np.empty((count, 3))

    def take() -> None:
        scan.cast()
        np.multiply(scan.directions, scan.distances[:, None], out=points)
        np.add(points, scan.starts, out=points)
        in_frame = points if frame is None else (points - frame.position) @ frame.rotation
        if isinstance(packed, CloudMessage):
            in_frame = in_frame[np.isfinite(scan.distances)]
            packed.set_count(len(in_frame))
            places[len(in_frame) :] = 0.0  # otherwise noise would accumulate there
        np.copyto(places[: len(in_frame)], in_frame, casting="same_kind")

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
    message.header.frame_id = settings.frame
    packed = PackedMessage(message)
    numbers = packed.numbers("data").view(np.float32)
    is_camera = isinstance(settings.pattern, DepthCamera)
    # The x component of a unit vector is the fraction of a distance along the axis.
    along_axis = scan.rays.directions[:, 0] if is_camera else np.ones(len(numbers))

    def take() -> None:
        scan.cast()
        np.multiply(scan.distances, along_axis, out=numbers, casting="same_kind")

    return Sampler(message=packed, take=take)


def _scan(source: SensorSource) -> tuple[RayCaster, Scan]:
    settings = source.rays
    if settings is None:
        raise ObeliskConfigError(
            "a sensor group with rays has neither `scan_config` nor `config_path`"
        )
    return settings, make_caster(source.model, source.data, settings)


OBK_SCAN = SensorKind(message_type=ObkScan, build=_build_scan)
"""obelisk_sensor_msgs/ObkScan: heights of a height scan's hits, or a lidar's distances."""

POINT_CLOUD = SensorKind(message_type=PointCloud2, build=_build_cloud)
"""sensor_msgs/PointCloud2: x, y, z, intensity of the hits, in the order of the rays."""

DEPTH_IMAGE = SensorKind(message_type=Image, build=_build_image)
"""sensor_msgs/Image 32FC1: distances along a depth camera's axis, or along a lidar's rays."""
