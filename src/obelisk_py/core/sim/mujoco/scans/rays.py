"""Patterns of rays, before they are turned and moved by offset and site.

In: a pattern. Out: unit directions and starts in the pattern's own frame, in the order in which the
message has them. x is forward, y left, z up.

Source: REP 103 (axes), sensor_msgs/CameraInfo (the middle of the first pixel is 0, 0).
"""

import math
from dataclasses import dataclass
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.sim.mujoco.scans.settings import (
    DepthCamera,
    HeightScan,
    LidarScan,
    Pattern,
)
from obelisk_spec.scans import grid_count, turn_count

__all__ = ["Rays", "lay_out"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rays:
    """Rays in the frame of their pattern."""

    directions: Array
    """Unit vectors, shape `(n, 3)`; `(1, 3)` for a pattern of parallel rays."""
    starts: Array
    """Where they start [m], shape `(n, 3)`; `(1, 3)` for rays from one point."""
    rows: int
    columns: int
    """Ray `i` stands in row `i // columns`; rows times columns is n."""


def lay_out(pattern: Pattern) -> Rays:
    """The rays of a pattern."""
    match pattern:
        case HeightScan():
            return _height_scan(pattern)
        case LidarScan():
            return _lidar_scan(pattern)
        case DepthCamera():
            return _depth_camera(pattern)
    assert_never(pattern)


def _height_scan(pattern: HeightScan) -> Rays:
    along_x = _centred(pattern.size_m[0], pattern.resolution_m)
    along_y = _centred(pattern.size_m[1], pattern.resolution_m)
    if pattern.x_is_faster:
        y, x = np.meshgrid(along_y, along_x, indexing="ij")
    else:
        x, y = np.meshgrid(along_x, along_y, indexing="ij")
    return Rays(
        directions=np.array([[0.0, 0.0, -1.0]]),
        starts=np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1),
        rows=x.shape[0],
        columns=x.shape[1],
    )


def _centred(length_m: float, resolution_m: float) -> Array:
    """Places along an axis [m], the middle of all at 0."""
    count = grid_count(length_m, resolution_m)
    numbers = np.arange(count, dtype=np.float64)
    places: Array = (numbers - (count - 1) / 2) * resolution_m
    return places


def _lidar_scan(pattern: LidarScan) -> Rays:
    up = np.radians(np.linspace(*pattern.vertical_deg, pattern.channels))
    first, last = pattern.horizontal_deg
    count = turn_count(last - first, pattern.horizontal_step_deg)
    step = math.copysign(pattern.horizontal_step_deg, last - first)
    left = np.radians(first + step * np.arange(count))
    v, h = np.meshgrid(up, left, indexing="ij")
    directions = np.stack([np.cos(v) * np.cos(h), np.cos(v) * np.sin(h), np.sin(v)], axis=-1)
    return Rays(
        directions=directions.reshape(-1, 3),
        starts=np.zeros((1, 3)),
        rows=pattern.channels,
        columns=count,
    )


def _depth_camera(pattern: DepthCamera) -> Rays:
    row, column = np.meshgrid(np.arange(pattern.height), np.arange(pattern.width), indexing="ij")
    (focal_x, focal_y), (centre_x, centre_y) = pattern.focal_lengths_px, pattern.centre_px
    down = (row - centre_y) / focal_y
    right = (column - centre_x - pattern.skew_px * down) / focal_x
    through = np.stack([np.ones(right.shape), -right, -down], axis=-1).reshape(-1, 3)
    return Rays(
        directions=through / np.linalg.norm(through, axis=1, keepdims=True),
        starts=np.zeros((1, 3)),
        rows=pattern.height,
        columns=pattern.width,
    )
