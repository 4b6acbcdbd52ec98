"""The camera of the viewer's page: it frames what moves when the page opens, and follows it."""

import math
from typing import Any, Final

import mujoco
import numpy as np
import viser
from mjviser import ViserMujocoScene
from numpy.typing import NDArray

__all__ = ["PageCamera", "moving_box"]

Point = NDArray[np.float64]
_FIELD_OF_VIEW_DEG: Final = 60
"""Vertically, when the page opens."""
_NARROWEST_DEG: Final = 20
_WIDEST_DEG: Final = 150


class PageCamera:
    """The first view of a page, and the controls of the camera.

    While the camera follows a body, the scene is drawn around it: that body is at the origin.
    """

    def __init__(
        self, server: viser.ViserServer, scene: ViserMujocoScene, data: mujoco.MjData
    ) -> None:
        """Set the view, and add the controls to the current container of the page.

        Args:
            server: the server of the page.
            scene: the scene, which follows the first body that moves.
            data: the current state.
        """
        self._server = server
        self._scene = scene
        self._data = data
        self._followed = int(np.argmax(scene.mj_model.body_weldid != 0))
        low, high = moving_box(scene.mj_model, data)
        look_at = (low + high) / 2 + self._shift()
        view = server.initial_camera
        view.position = look_at + _direction(scene.mj_model) * _distance(low, high)
        view.look_at = look_at
        view.fov = math.radians(_FIELD_OF_VIEW_DEG)
        self._follow = server.gui.add_checkbox(
            "Track camera",
            initial_value=scene.camera_tracking_enabled,
            hint="Follow the first body that moves.",
        )
        self._width = server.gui.add_slider(
            "Field of view (°)",
            min=_NARROWEST_DEG,
            max=_WIDEST_DEG,
            step=1,
            initial_value=_FIELD_OF_VIEW_DEG,
        )
        self._follow.on_update(self._on_follow)
        self._width.on_update(self._on_width)

    def _shift(self) -> Point:
        """From the world to the scene [m]."""
        if not self._scene.camera_tracking_enabled:
            return np.zeros(3)
        followed: Point = self._data.xpos[self._followed]
        return -followed

    def _on_follow(self, _event: Any) -> None:
        before = self._shift()
        self._scene.camera_tracking_enabled = self._follow.value
        self._scene.needs_update = True
        # The view stays the same, although the scene moves.
        moved = self._shift() - before
        for client in self._server.get_clients().values():
            position, look_at = client.camera.position + moved, client.camera.look_at + moved
            client.camera.position = position
            client.camera.look_at = look_at

    def _on_width(self, _event: Any) -> None:
        for client in self._server.get_clients().values():
            client.camera.fov = math.radians(self._width.value)


def moving_box(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Point, Point]:
    """The corners of a box around what moves, or around the whole model if nothing does [m]."""
    moving = (model.body_weldid[model.geom_bodyid] != 0) & (model.geom_rbound > 0)
    if not moving.any():
        half = model.stat.extent / 2
        return model.stat.center - half, model.stat.center + half
    centers, radii = data.geom_xpos[moving], model.geom_rbound[moving][:, None]
    low: Point = (centers - radii).min(axis=0)
    high: Point = (centers + radii).max(axis=0)
    return low, high


def _direction(model: mujoco.MjModel) -> Point:
    """Unit vector from the point that the camera looks at to the camera, as set in the model."""
    azimuth = math.radians(model.vis.global_.azimuth)
    elevation = math.radians(model.vis.global_.elevation)
    return np.array(
        [
            -math.cos(elevation) * math.cos(azimuth),
            -math.cos(elevation) * math.sin(azimuth),
            -math.sin(elevation),
        ]
    )


def _distance(low: Point, high: Point) -> float:
    """Distance from the center of a box at which the camera sees all of it [m]."""
    size = float(np.linalg.norm(high - low))
    return size / 2 / math.sin(math.radians(_FIELD_OF_VIEW_DEG) / 2)
