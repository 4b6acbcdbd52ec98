"""Sample the model's geoms as markers for a visualizer.

The inputs are names of geoms and the state; the output is a `visualization_msgs/MarkerArray` in the
frame `world`. Marker sizes are full lengths, as RViz expects; MuJoCo's sizes are half lengths and
radii. RViz has no marker for a capsule, so a capsule becomes a cylinder and two spheres.

Source: visualization_msgs/Marker.msg; MuJoCo XML reference, body/geom/size.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import mujoco
import numpy as np
from visualization_msgs.msg import Marker, MarkerArray

from obelisk_py.core.serialization.codec import PackedMessage
from obelisk_py.core.sim.mujoco.sensors.kind import WORLD, Copy, Sampler, in_turn, set_quaternion

__all__ = ["GEOM_KINDS", "MARKER_NAMESPACE", "marker_sampler"]

MARKER_NAMESPACE: Final = "mujoco"
_UNPAINTED: Final = (0.5, 0.5, 0.5, 1.0)
"""MuJoCo's default rgba of a geom, which a material overrides."""

Sizes = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Part:
    """One marker of a geom."""

    marker_type: int
    scale: Sizes
    """Full lengths along x, y, z [m]."""
    along_z: float = 0.0
    """Offset from the geom's center along its own z axis [m]."""


def _box(x: float, y: float, z: float) -> tuple[_Part, ...]:
    return (_Part(marker_type=Marker.CUBE, scale=(2 * x, 2 * y, 2 * z)),)


def _sphere(radius: float, _y: float, _z: float) -> tuple[_Part, ...]:
    return (_Part(marker_type=Marker.SPHERE, scale=(2 * radius, 2 * radius, 2 * radius)),)


def _ellipsoid(x: float, y: float, z: float) -> tuple[_Part, ...]:
    return (_Part(marker_type=Marker.SPHERE, scale=(2 * x, 2 * y, 2 * z)),)


def _cylinder(radius: float, half: float, _z: float) -> tuple[_Part, ...]:
    return (_Part(marker_type=Marker.CYLINDER, scale=(2 * radius, 2 * radius, 2 * half)),)


def _capsule(radius: float, half: float, z: float) -> tuple[_Part, ...]:
    ball: Sizes = (2 * radius, 2 * radius, 2 * radius)
    return (
        *_cylinder(radius, half, z),
        _Part(marker_type=Marker.SPHERE, scale=ball, along_z=half),
        _Part(marker_type=Marker.SPHERE, scale=ball, along_z=-half),
    )


GEOM_KINDS: Final[Mapping[str, Callable[[float, float, float], tuple[_Part, ...]]]] = (
    MappingProxyType(
        {
            "box": _box,
            "sphere": _sphere,
            "cylinder": _cylinder,
            "capsule": _capsule,
            "ellipsoid": _ellipsoid,
        }
    )
)
"""Geom type -> function that returns its markers for MuJoCo's three sizes."""


def marker_sampler(model: mujoco.MjModel, data: mujoco.MjData, geoms: Mapping[str, str]) -> Sampler:
    """Create a sampler of the markers in the current state.

    Args:
        model: the model.
        data: its state.
        geoms: geom name -> geom type, a key of `GEOM_KINDS`.
    """
    parts = [
        (model.geom(name).id, part)
        for name, kind in geoms.items()
        for part in GEOM_KINDS[kind](*model.geom(name).size.tolist())
    ]
    markers = [
        _marker(number, part, _colour(model, geom)) for number, (geom, part) in enumerate(parts)
    ]
    packed = PackedMessage(MarkerArray(markers=markers))
    placings = [
        _placing(data, geom, part.along_z, packed, f"markers.{number}.pose")
        for number, (geom, part) in enumerate(parts)
    ]
    return Sampler(message=packed, take=in_turn(placings))


def _marker(number: int, part: _Part, colour: Iterable[float]) -> Marker:
    marker = Marker(ns=MARKER_NAMESPACE, id=number, type=part.marker_type, action=Marker.ADD)
    marker.header.frame_id = WORLD
    marker.scale.x, marker.scale.y, marker.scale.z = part.scale
    marker.color.r, marker.color.g, marker.color.b, marker.color.a = colour
    return marker


def _placing(
    data: mujoco.MjData, geom: int, along_z: float, message: PackedMessage, pose: str
) -> Copy:
    """Return a function that moves a marker to its geom."""
    position, orientation = (
        message.numbers(f"{pose}.{part}") for part in ("position", "orientation")
    )
    centre, rotation = data.geom_xpos[geom], data.geom_xmat[geom]
    axis_z = rotation[2::3]
    wxyz = np.empty(4)

    def place() -> None:
        position[:] = centre + along_z * axis_z
        mujoco.mju_mat2Quat(wxyz, rotation)
        set_quaternion(orientation, wxyz)

    return place


def _colour(model: mujoco.MjModel, geom: int) -> list[float]:
    own: list[float] = model.geom_rgba[geom].tolist()
    material = int(model.geom_matid[geom])
    if material < 0 or not np.allclose(own, _UNPAINTED):
        return own
    painted: list[float] = model.mat_rgba[material].tolist()
    return painted
