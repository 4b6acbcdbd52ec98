"""Frames of a model by name: where they are at the present state.

In: a model, its data, a name. Out: views of MuJoCo's own memory.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

__all__ = ["WORLD", "Frame", "find_frame"]

Array = NDArray[np.float64]

WORLD = "world"
"""Name of the frame that is fixed."""


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
