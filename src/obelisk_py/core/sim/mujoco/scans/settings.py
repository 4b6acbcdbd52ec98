"""A ray caster's settings, typed.

In: the mapping of `scan_config`, with no findings against it. Out: a frozen `RayCaster`, angles and
lengths in the units of the language.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

__all__ = ["DepthCamera", "HeightScan", "LidarScan", "Pattern", "RayCaster", "typed_ray_caster"]

_NO_TURN: Final = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightScan:
    """A level grid of parallel rays."""

    resolution_m: float
    """Between two rays [m]."""
    size_m: tuple[float, float]
    """Along x and y [m]."""
    x_is_faster: bool
    """Whether neighbours in the message are neighbours along x."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarScan:
    """Rays over two ranges of angles, from one point."""

    channels: int
    vertical_deg: tuple[float, float]
    """First and last channel [deg], positive is up."""
    horizontal_deg: tuple[float, float]
    """From x to the left [deg]."""
    horizontal_step_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthCamera:
    """A ray through each pixel of a pinhole camera that looks along x."""

    width: int
    height: int
    focal_lengths_px: tuple[float, float]
    centre_px: tuple[float, float]
    """Where the axis meets the picture; the middle of the first pixel is 0, 0."""
    skew_px: float


Pattern = HeightScan | LidarScan | DepthCamera


@dataclass(frozen=True, slots=True, kw_only=True)
class RayCaster:
    """Where rays start, how they are laid out and what they hit."""

    site: str
    pattern: Pattern
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    offset_wxyz: tuple[float, float, float, float] = _NO_TURN
    geom_groups: tuple[int, ...] = ()
    """Groups of geoms that are hit; empty: all."""
    frame: str | None = None
    """As written."""
    max_distance_m: float = math.inf


def typed_ray_caster(scan: Mapping[str, Any]) -> RayCaster:
    """The values of a `scan_config` that has no findings."""
    pattern = scan["pattern"]
    offset = pattern.get("offset") or {}
    x, y, z = offset.get("pos") or (0.0, 0.0, 0.0)
    qw, qx, qy, qz = offset.get("rot") or _NO_TURN
    return RayCaster(
        site=scan["site_name"],
        pattern=_typed_pattern(pattern),
        offset_m=(float(x), float(y), float(z)),
        offset_wxyz=(float(qw), float(qx), float(qy), float(qz)),
        geom_groups=tuple(scan.get("geom_groups") or ()),
        frame=scan.get("frame"),
        max_distance_m=float(scan.get("max_distance") or math.inf),
    )


def _typed_pattern(pattern: Mapping[str, Any]) -> Pattern:
    match pattern["type"]:
        case "height_scan":
            return HeightScan(
                resolution_m=float(pattern["resolution"]),
                size_m=_pair(pattern["size"]),
                x_is_faster=(pattern.get("ordering") or "xy") == "xy",
            )
        case "lidar_scan":
            return LidarScan(
                channels=pattern["channels"],
                vertical_deg=_pair(pattern["vertical_fov_range"]),
                horizontal_deg=_pair(pattern["horizontal_fov_range"]),
                horizontal_step_deg=float(pattern["horizontal_res"]),
            )
    matrix = pattern["intrinsic_matrix"]
    return DepthCamera(
        width=pattern["width"],
        height=pattern["height"],
        focal_lengths_px=(float(matrix[0]), float(matrix[4])),
        centre_px=(float(matrix[2]), float(matrix[5])),
        skew_px=float(matrix[1]),
    )


def _pair(values: Any) -> tuple[float, float]:
    first, second = values
    return float(first), float(second)
