"""Render off-screen images from the model's cameras.

The inputs are a model, the index of a camera or None, the state at `update`, and the environment
and libraries on this machine. `CameraView.update` may be called on any thread. All other calls must
be made on the thread that created the view, because an OpenGL context belongs to one thread.

Source: https://mujoco.readthedocs.io/en/stable/programming/visualization.html (back ends).
"""

import importlib
import os
from collections.abc import Callable, Mapping
from ctypes.util import find_library
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.exceptions import ObeliskConfigError

__all__ = ["CameraView", "choose_back_end", "open_context", "picture_size"]

_LIBRARIES: Final = {"egl": "EGL", "osmesa": "OSMesa"}
"""Back end -> the library that it needs, in order of preference."""
_FIX: Final = (
    "`obk doctor` reports which back ends work on this machine; `apt install libegl1 "
    "libgl1-mesa-dri` installs one that needs neither a display nor a graphics card"
)
_DEFAULT_SIZE = (640, 480)
"""Width and height of a camera if the model sets none [pixels]."""
_UNSET = 1
"""MuJoCo's value for width and height if the model sets none."""


def choose_back_end(
    environment: Mapping[str, str] = os.environ,
    find: Callable[[str], str | None] = find_library,
) -> str:
    """Return the back end in MUJOCO_GL if set, otherwise the first whose library is installed.

    Raises:
        ObeliskConfigError: no library is installed, or MUJOCO_GL names a back end that needs a
            screen.
    """
    chosen = environment.get("MUJOCO_GL", "").strip().lower()
    if chosen in _LIBRARIES:
        return chosen
    if chosen:
        raise ObeliskConfigError(
            f"MUJOCO_GL is `{chosen}`, which cannot render off-screen; set it to `egl` or "
            "`osmesa`, or unset it to choose one automatically"
        )
    for back_end, library in _LIBRARIES.items():
        if find(library) is not None:
            return back_end
    raise ObeliskConfigError(
        f"cameras need OpenGL, and neither libEGL nor libOSMesa was found; {_FIX}"
    )


def open_context(
    back_end: str,
    width: int,
    height: int,
    load: Callable[[str], Any] = importlib.import_module,
) -> Any:
    """Open an OpenGL context for images up to this size, and make it current on this thread.

    Raises:
        ObeliskConfigError: the back end does not work.
    """
    try:
        context = load(f"mujoco.{back_end}").GLContext(width, height)
        context.make_current()
    # Each back end and driver raises its own exceptions, including AttributeError.
    except Exception as error:
        raise ObeliskConfigError(
            f"cameras need OpenGL, and the back end `{back_end}` does not work: "
            f"{type(error).__name__}: {error}; {_FIX}"
        ) from error
    return context


def picture_size(model: mujoco.MjModel, camera: int | None) -> tuple[int, int]:
    """Width and height of a camera's images [pixels]: its `resolution`, otherwise 640 x 480."""
    if camera is None:
        return _DEFAULT_SIZE
    width, height = (int(length) for length in model.cam_resolution[camera])
    return _DEFAULT_SIZE if width == height == _UNSET else (width, height)


class CameraView:
    """Renders one camera; call `update`, then `draw`."""

    def __init__(
        self,
        model: mujoco.MjModel,
        camera: int | None,
        back_end: str,
        size: tuple[int, int] | None = None,
    ) -> None:
        """Open OpenGL and upload the model.

        Args:
            model: the model.
            camera: index of the camera; None for a view of the whole model.
            back_end: as returned by `choose_back_end`.
            size: width and height [pixels]; None for the camera's own size.

        Raises:
            ObeliskConfigError: OpenGL does not work.
        """
        width, height = size or picture_size(model, camera)
        self._model = model
        self._scene = mujoco.MjvScene(model, maxgeom=_most_geoms(model))
        self._option = mujoco.MjvOption()
        self._perturbation = mujoco.MjvPerturb()
        self._camera = mujoco.MjvCamera()
        if camera is None:
            mujoco.mjv_defaultFreeCamera(model, self._camera)
        else:
            self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
            self._camera.fixedcamid = camera
        self._context = open_context(back_end, width, height)
        self._drawing = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_resizeOffscreen(width, height, self._drawing)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._drawing)
        self._area = mujoco.MjrRect(0, 0, width, height)
        self._pixels = np.empty((height, width, 3), np.uint8)

    def update(self, data: mujoco.MjData) -> None:
        """Copy the state of the scene without rendering."""
        mujoco.mjv_updateScene(
            self._model,
            data,
            self._option,
            self._perturbation,
            self._camera,
            mujoco.mjtCatBit.mjCAT_ALL,
            self._scene,
        )

    def draw(self) -> NDArray[np.uint8]:
        """Render the last `update`, shape `(height, width, 3)`, top row first.

        It returns a view of memory that the next `draw` overwrites.
        """
        mujoco.mjr_render(self._area, self._scene, self._drawing)
        mujoco.mjr_readPixels(self._pixels, None, self._area, self._drawing)
        return self._pixels[::-1]

    def close(self) -> None:
        """Release the OpenGL resources."""
        self._drawing.free()
        self._context.free()


def _most_geoms(model: mujoco.MjModel) -> int:
    """Upper bound: the model's geoms, lights and other elements, and the scene's decorations."""
    return int(model.ngeom + model.nlight + model.nsite + model.nskin + model.nflex) + 1000
