"""Ray casters: `ObkScan`, `PointCloud2`, `DepthImage`.

In: the group's ray caster. A ray that hits nothing is NaN in all of them. `header.frame_id` is the
`frame` of the config, else the site; the points of a cloud are given in that frame.

Source: sensor_msgs/PointCloud2.msg; REP 118 (a depth image holds distances along the axis).
"""

import sys
from array import array
from typing import Final

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from obelisk_sensor_msgs.msg import ObkScan
from sensor_msgs.msg import Image, PointCloud2, PointField

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.scans import RayCaster, Scan, make_caster
from obelisk_py.core.sim.mujoco.scans.frames import find_frame
from obelisk_py.core.sim.mujoco.scans.settings import DepthCamera
from obelisk_py.core.sim.mujoco.sensors.kind import Sampler, SensorKind, SensorSource

__all__ = ["DEPTH_IMAGE", "OBK_SCAN", "POINT_CLOUD"]

_FLOAT_BYTES: Final = 4
_POINT_BYTES: Final = 3 * _FLOAT_BYTES


def _build_scan(source: SensorSource) -> Sampler:
    settings, scan = _scan(source)
    frame, numbers = settings.frame or settings.site, _floats(scan)

    def sample(stamp: Time) -> ObkScan:
        scan.cast()
        np.copyto(numbers, scan.distances, casting="same_kind")
        message = ObkScan()
        message.header.stamp = stamp
        message.header.frame_id = frame
        message.data = array("f", numbers.tobytes())
        return message

    return sample


def _build_cloud(source: SensorSource) -> Sampler:
    settings, scan = _scan(source)
    name = settings.frame or settings.site
    frame = find_frame(source.model, source.data, name)
    rows, columns = scan.rays.rows, scan.rays.columns
    fields = [
        PointField(name=axis, offset=place * _FLOAT_BYTES, datatype=PointField.FLOAT32, count=1)
        for place, axis in enumerate("xyz")
    ]
    points = np.empty((rows * columns, 3))
    numbers = np.empty((rows * columns, 3), np.float32)

    def sample(stamp: Time) -> PointCloud2:
        scan.cast()
        np.multiply(scan.directions, scan.distances[:, None], out=points)
        np.add(points, scan.starts, out=points)
        if frame is None:
            np.copyto(numbers, points, casting="same_kind")
        else:
            np.subtract(points, frame.position, out=points)
            np.copyto(numbers, points @ frame.rotation, casting="same_kind")
        message = PointCloud2()
        message.header.stamp = stamp
        message.header.frame_id = name
        message.height, message.width = rows, columns
        message.fields = fields
        message.is_bigendian = sys.byteorder == "big"
        message.point_step, message.row_step = _POINT_BYTES, _POINT_BYTES * columns
        message.data = array("B", numbers.tobytes())
        return message

    return sample


def _build_image(source: SensorSource) -> Sampler:
    settings, scan = _scan(source)
    frame, numbers = settings.frame or settings.site, _floats(scan)
    is_camera = isinstance(settings.pattern, DepthCamera)
    # Of a unit vector, the x component is the part of a distance that lies along the axis.
    along_axis = scan.rays.directions[:, 0] if is_camera else np.ones(len(numbers))

    def sample(stamp: Time) -> Image:
        scan.cast()
        np.multiply(scan.distances, along_axis, out=numbers, casting="same_kind")
        message = Image()
        message.header.stamp = stamp
        message.header.frame_id = frame
        message.height, message.width = scan.rays.rows, scan.rays.columns
        message.encoding = "32FC1"
        message.is_bigendian = int(sys.byteorder == "big")
        message.step = _FLOAT_BYTES * scan.rays.columns
        message.data = array("B", numbers.tobytes())
        return message

    return sample


def _scan(source: SensorSource) -> tuple[RayCaster, Scan]:
    settings = source.rays
    if settings is None:
        raise ObeliskConfigError(
            "a sensor group that casts rays has neither `scan_config` nor `config_path`"
        )
    return settings, make_caster(source.model, source.data, settings)


def _floats(scan: Scan) -> NDArray[np.float32]:
    return np.empty(len(scan.distances), np.float32)


OBK_SCAN = SensorKind(message_type=ObkScan, build=_build_scan)
"""obelisk_sensor_msgs/ObkScan: distances along the rays."""

POINT_CLOUD = SensorKind(message_type=PointCloud2, build=_build_cloud)
"""sensor_msgs/PointCloud2: x, y, z of the hits, in the order of the rays."""

DEPTH_IMAGE = SensorKind(message_type=Image, build=_build_image)
"""sensor_msgs/Image 32FC1: a depth camera's distances along its axis, a lidar's along its rays."""
