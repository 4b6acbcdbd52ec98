"""Rays cast at the present state of a simulation.

In: a model, its data, a ray caster's settings. Out: distances, and where the rays are in the world,
in arrays that are made once and filled anew by each `cast`. Geoms of the site's own body are not
hit, nor are those that cannot be seen (alpha 0), which is MuJoCo's rule for rays.
"""

import math
from typing import Final, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.sim.mujoco.scans.rays import Rays, lay_out
from obelisk_py.core.sim.mujoco.scans.settings import HeightScan, RayCaster

__all__ = ["LevelCaster", "Scan", "SiteCaster", "make_caster"]

Array = NDArray[np.float64]

_FARTHEST_M: Final = 1e10
"""MuJoCo's own limit for lengths (mjMAXVAL)."""
_WORLD_BODY: Final = 0
_NO_BODY: Final = -1


class Scan(Protocol):
    """What a cast leaves behind; all in the world."""

    rays: Rays
    """As laid out, in the frame of the pattern."""
    distances: Array
    """Along the rays [m], shape `(n,)`; NaN for no hit."""
    starts: Array
    """[m], shape `(n, 3)` or `(1, 3)`."""
    directions: Array
    """Unit vectors, shape `(n, 3)` or `(1, 3)`."""

    def cast(self) -> None:
        """Fill the arrays for the present state."""


def make_caster(model: mujoco.MjModel, data: mujoco.MjData, settings: RayCaster) -> Scan:
    """The caster of a pattern; the model must have the site."""
    if isinstance(settings.pattern, HeightScan):
        return LevelCaster(model, data, settings)
    return SiteCaster(model, data, settings)


class SiteCaster:
    """Rays from one point that turn with the site: lidar, depth camera; one call of MuJoCo's."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, settings: RayCaster) -> None:
        """Lay the rays out and find the site."""
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
        """Fill the arrays for the present state."""
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
    """Parallel rays from a grid that stays level: of the site's turn only the heading counts.

    The heading is that of the site's x axis. Every ray has a start of its own, so each is a call.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, settings: RayCaster) -> None:
        """Lay the rays out and find the site."""
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
        """Fill the arrays for the present state."""
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
        # A site that points straight up or down has no heading; north is as good as any.
        cosine, sine = (x_axis / length, y_axis / length) if length > 1e-9 else (1.0, 0.0)
        level = self._level
        level[0, 0] = level[1, 1] = cosine
        level[1, 0], level[0, 1] = sine, -sine


def _rotation(wxyz: tuple[float, float, float, float]) -> Array:
    """The matrix of a quaternion of any length, shape `(3, 3)`."""
    unit, matrix = np.array(wxyz), np.empty(9)
    mujoco.mju_normalize4(unit)
    mujoco.mju_quat2Mat(matrix, unit)
    return matrix.reshape(3, 3)


def _own_body(model: mujoco.MjModel, site: int) -> int:
    """The body whose geoms are not hit; a site of the world sees the world."""
    body = int(model.site_bodyid[site])
    return _NO_BODY if body == _WORLD_BODY else body


def _group_flags(settings: RayCaster) -> NDArray[np.uint8] | None:
    if not settings.geom_groups:
        return None
    flags = np.zeros(mujoco.mjNGROUP, np.uint8)
    flags[list(settings.geom_groups)] = 1
    return flags


def _drop_misses(distances: Array, farthest_m: float) -> None:
    """NaN for what MuJoCo tells as -1, and for what is beyond."""
    distances[(distances < 0.0) | (distances > farthest_m)] = np.nan
