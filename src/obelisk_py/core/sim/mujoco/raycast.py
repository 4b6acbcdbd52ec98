"""Cast rays: from the `scan_config` of a sensor group to distances in the current state.

The inputs are the mapping of a valid `scan_config`, a model and its data. The outputs are distances
and the rays in the world frame. Their arrays are allocated once and filled by each `cast`. Patterns
are laid out in their own frame, x forward, y left, z up, in the order of the message. Rays do not
hit geoms of the site's own body, nor invisible geoms (alpha 0), which is MuJoCo's rule.

Source: REP 103 (axes), sensor_msgs/CameraInfo (the center of the first pixel is 0, 0).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol, assert_never

import mujoco
import numpy as np
from numpy.typing import NDArray

from obelisk_spec.scans import DEFAULT_FRAME, DEFAULT_GROUPS, grid_count, lidar_columns

__all__ = [
    "DepthCamera",
    "HeightScan",
    "LevelCaster",
    "LidarScan",
    "Pattern",
    "RayCaster",
    "Rays",
    "Scan",
    "SiteCaster",
    "lay_out",
    "make_caster",
    "typed_ray_caster",
]

_NO_TURN: Final = (1.0, 0.0, 0.0, 0.0)
_DOWN: Final = (0.0, 0.0, -1.0)
_HALF_PIXEL: Final = 0.5
Array = NDArray[np.float64]
_FARTHEST_M: Final = 1e10
"""MuJoCo's limit for lengths (mjMAXVAL)."""
_WORLD_BODY: Final = 0
_NO_BODY: Final = -1


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightScan:
    """A horizontal grid of parallel rays."""

    resolution_m: float
    """Distance between neighboring rays [m]."""
    size_m: tuple[float, float]
    """Along x and y [m]."""
    x_is_faster: bool
    """Whether consecutive rays in the message are neighbors along x."""
    direction: tuple[float, float, float]
    """Direction of all rays; need not be normalized."""
    holds_height: bool
    """Whether a scan contains the world z of each hit, as opposed to its distance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarScan:
    """Rays from one point over two ranges of angles."""

    channels: int
    vertical_deg: tuple[float, float]
    """First and last channel [deg], positive upward."""
    horizontal_deg: tuple[float, float]
    """From the x axis to the left [deg]."""
    horizontal_step_deg: float
    is_exact: bool
    """Whether the spacing is exactly the step; see `lidar_columns`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthCamera:
    """A ray through each pixel of a pinhole camera that looks along x."""

    width: int
    height: int
    focal_lengths_px: tuple[float, float]
    centre_px: tuple[float, float]
    """Where the optical axis meets the image; the center of the first pixel is 0, 0."""
    skew_px: float
    through_centres: bool
    """Whether rays pass through pixel centers, as opposed to the corners half a pixel further."""


Pattern = HeightScan | LidarScan | DepthCamera


@dataclass(frozen=True, slots=True, kw_only=True)
class RayCaster:
    """Settings of a ray caster: position, pattern, and the geoms that rays hit."""

    site: str
    pattern: Pattern
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    offset_wxyz: tuple[float, float, float, float] = _NO_TURN
    geom_groups: tuple[int, ...] = DEFAULT_GROUPS
    """Groups of geoms that rays hit; empty for all."""
    frame: str = DEFAULT_FRAME
    """The `frame_id` of the header."""
    points_in_frame: bool = False
    """Whether the points of a cloud are given in `frame`, as opposed to the site's frame."""
    keeps_misses: bool = False
    """Whether a cloud has a point for every ray, NaN for a miss, as opposed to hits only."""
    max_distance_m: float = math.inf


def typed_ray_caster(scan: Mapping[str, Any]) -> RayCaster:
    """Read the settings of a valid `scan_config`."""
    pattern = scan["pattern"]
    offset = pattern.get("offset") or {}
    x, y, z = offset.get("pos") or (0.0, 0.0, 0.0)
    qw, qx, qy, qz = offset.get("rot") or _NO_TURN
    groups = scan.get("geom_groups")
    return RayCaster(
        site=scan["site_name"],
        pattern=_typed_pattern(pattern),
        offset_m=(float(x), float(y), float(z)),
        offset_wxyz=(float(qw), float(qx), float(qy), float(qz)),
        geom_groups=DEFAULT_GROUPS if groups is None else tuple(groups),
        frame=scan.get("frame") or DEFAULT_FRAME,
        points_in_frame=scan.get("points_in") == "frame",
        keeps_misses=bool(scan.get("keep_misses")),
        # 0 means no limit.
        max_distance_m=float(scan.get("max_distance") or math.inf),
    )


def _typed_pattern(pattern: Mapping[str, Any]) -> Pattern:
    match pattern["type"]:
        case "height_scan":
            x, y, z = pattern.get("direction") or _DOWN
            return HeightScan(
                resolution_m=float(pattern["resolution"]),
                size_m=_pair(pattern["size"]),
                x_is_faster=(pattern.get("ordering") or "xy") == "xy",
                direction=(float(x), float(y), float(z)),
                holds_height=(pattern.get("values") or "height") == "height",
            )
        case "lidar_scan":
            return LidarScan(
                channels=pattern["channels"],
                vertical_deg=_pair(pattern["vertical_fov_range"]),
                horizontal_deg=_pair(pattern["horizontal_fov_range"]),
                horizontal_step_deg=float(pattern["horizontal_res"]),
                is_exact=pattern.get("spacing") == "exact",
            )
    matrix = pattern["intrinsic_matrix"]
    return DepthCamera(
        width=pattern["width"],
        height=pattern["height"],
        focal_lengths_px=(float(matrix[0]), float(matrix[4])),
        centre_px=(float(matrix[2]), float(matrix[5])),
        skew_px=float(matrix[1]),
        through_centres=pattern.get("rays_through") == "centres",
    )


def _pair(values: Any) -> tuple[float, float]:
    first, second = values
    return float(first), float(second)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rays:
    """Rays in the frame of their pattern."""

    directions: Array
    """Unit vectors, shape `(n, 3)`; `(1, 3)` for a pattern of parallel rays."""
    starts: Array
    """Origins of the rays [m], shape `(n, 3)`; `(1, 3)` for rays from one point."""
    rows: int
    columns: int
    """Ray `i` is in row `i // columns`; rows * columns = n."""


def lay_out(pattern: Pattern) -> Rays:
    """Compute the rays of a pattern."""
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
        directions=np.array([pattern.direction]) / math.hypot(*pattern.direction),
        starts=np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1),
        rows=x.shape[0],
        columns=x.shape[1],
    )


def _centred(length_m: float, resolution_m: float) -> Array:
    """Return positions along an axis [m], centered at 0."""
    count = grid_count(length_m, resolution_m)
    numbers = np.arange(count, dtype=np.float64)
    places: Array = (numbers - (count - 1) / 2) * resolution_m
    return places


def _lidar_scan(pattern: LidarScan) -> Rays:
    up = np.radians(np.linspace(*pattern.vertical_deg, pattern.channels))
    first, last = pattern.horizontal_deg
    count, step = lidar_columns(
        last - first, pattern.horizontal_step_deg, is_exact=pattern.is_exact
    )
    left = np.radians(first + math.copysign(step, last - first) * np.arange(count))
    v, h = np.meshgrid(up, left, indexing="ij")
    directions = np.stack([np.cos(v) * np.cos(h), np.cos(v) * np.sin(h), np.sin(v)], axis=-1)
    return Rays(
        directions=directions.reshape(-1, 3),
        starts=np.zeros((1, 3)),
        rows=pattern.channels,
        columns=count,
    )


def _depth_camera(pattern: DepthCamera) -> Rays:
    shift = 0.0 if pattern.through_centres else _HALF_PIXEL
    row, column = np.meshgrid(
        np.arange(pattern.height) + shift, np.arange(pattern.width) + shift, indexing="ij"
    )
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


class Scan(Protocol):
    """The result of a cast, in the world frame."""

    rays: Rays
    """The rays as laid out, in the frame of the pattern."""
    distances: Array
    """Distances along the rays [m], shape `(n,)`; NaN for a miss."""
    starts: Array
    """Origins of the rays [m], shape `(n, 3)` or `(1, 3)`."""
    directions: Array
    """Unit vectors, shape `(n, 3)` or `(1, 3)`."""

    def cast(self) -> None:
        """Fill the arrays for the current state."""


def make_caster(model: mujoco.MjModel, data: mujoco.MjData, settings: RayCaster) -> Scan:
    """Create the caster for a pattern; the model must have the site."""
    if isinstance(settings.pattern, HeightScan):
        return LevelCaster(model, data, settings)
    return SiteCaster(model, data, settings)


class SiteCaster:
    """Casts rays from one point that rotate with the site (lidar, depth camera), in one call."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, settings: RayCaster) -> None:
        """Lay out the rays and find the site."""
        self.rays = lay_out(settings.pattern)
        count = len(self.rays.directions)
        self.distances = np.empty(count)
        self.starts = np.empty((1, 3))
        self.directions = np.empty((count, 3))
        self._model, self._data = model, data
        self._offset = np.array(settings.offset_m)
        self._in_site = self.rays.directions @ _rotation(settings.offset_wxyz).T
        site = model.site(settings.site).id
        self._position = data.site_xpos[site]
        self._rotation = data.site_xmat[site].reshape(3, 3)
        self._own_body = _own_body(model, site)
        self._groups = _group_flags(settings)
        self._farthest_m = settings.max_distance_m
        self._hit = np.empty(count, np.int32)
        self._start = self.starts[0]
        self._flat = self.directions.reshape(-1)

    def cast(self) -> None:
        """Fill the arrays for the current state."""
        np.matmul(self._in_site, self._rotation.T, out=self.directions)
        np.matmul(self._rotation, self._offset, out=self._start)
        self._start += self._position
        mujoco.mj_multiRay(
            self._model,
            self._data,
            self._start,
            self._flat,
            self._groups,
            True,
            self._own_body,
            self._hit,
            self.distances,
            None,
            len(self.distances),
            min(self._farthest_m, _FARTHEST_M),
        )
        _drop_misses(self.distances, self._farthest_m)


class LevelCaster:
    """Casts parallel rays from a grid that stays level and only follows the site's heading.

    The heading is that of the site's x axis. Each ray has its own origin and needs its own call.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, settings: RayCaster) -> None:
        """Lay out the rays and find the site."""
        self.rays = lay_out(settings.pattern)
        count = len(self.rays.starts)
        self.distances = np.empty(count)
        self.starts = np.empty((count, 3))
        self.directions = np.empty((1, 3))
        self._model, self._data = model, data
        turn = _rotation(settings.offset_wxyz)
        self._in_level = np.array(settings.offset_m) + self.rays.starts @ turn.T
        self._down = self.rays.directions @ turn.T
        site = model.site(settings.site).id
        self._position = data.site_xpos[site]
        self._rotation = data.site_xmat[site].reshape(3, 3)
        self._own_body = _own_body(model, site)
        self._groups = _group_flags(settings)
        self._farthest_m = settings.max_distance_m
        self._level = np.eye(3)
        self._start_of = tuple(self.starts)

    def cast(self) -> None:
        """Fill the arrays for the current state."""
        self._turn_level()
        np.matmul(self._in_level, self._level.T, out=self.starts)
        self.starts += self._position
        np.matmul(self._down, self._level.T, out=self.directions)
        model, data, direction = self._model, self._data, self.directions[0]
        groups, own_body, ray = self._groups, self._own_body, mujoco.mj_ray
        self.distances[:] = [
            ray(model, data, start, direction, groups, True, own_body, None)
            for start in self._start_of
        ]
        _drop_misses(self.distances, self._farthest_m)

    def _turn_level(self) -> None:
        x_axis, y_axis = float(self._rotation[0, 0]), float(self._rotation[1, 0])
        length = math.hypot(x_axis, y_axis)
        # A site that points straight up or down has no heading, so use that of the world's x axis.
        cosine, sine = (x_axis / length, y_axis / length) if length > 1e-9 else (1.0, 0.0)
        level = self._level
        level[0, 0] = level[1, 1] = cosine
        level[1, 0], level[0, 1] = sine, -sine


def _rotation(wxyz: tuple[float, float, float, float]) -> Array:
    """Return the rotation matrix of a quaternion, which need not be normalized, shape `(3, 3)`."""
    unit, matrix = np.array(wxyz), np.empty(9)
    mujoco.mju_normalize4(unit)
    mujoco.mju_quat2Mat(matrix, unit)
    return matrix.reshape(3, 3)


def _own_body(model: mujoco.MjModel, site: int) -> int:
    """Return the body whose geoms rays do not hit; none for a site attached to the world."""
    body = int(model.site_bodyid[site])
    return _NO_BODY if body == _WORLD_BODY else body


def _group_flags(settings: RayCaster) -> NDArray[np.uint8] | None:
    if not settings.geom_groups:
        return None
    flags = np.zeros(mujoco.mjNGROUP, np.uint8)
    flags[list(settings.geom_groups)] = 1
    return flags


def _drop_misses(distances: Array, farthest_m: float) -> None:
    """Set misses (-1 in MuJoCo) and hits beyond the maximum distance to NaN."""
    distances[(distances < 0.0) | (distances > farthest_m)] = np.nan
