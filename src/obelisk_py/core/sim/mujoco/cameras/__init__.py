"""Pictures of the model's cameras, drawn off screen.

`back_end` opens OpenGL, `view` draws one camera, `sensors.image` makes messages of it.
"""

from obelisk_py.core.sim.mujoco.cameras.back_end import choose_back_end, open_context
from obelisk_py.core.sim.mujoco.cameras.view import CameraView, picture_size

__all__ = ["CameraView", "choose_back_end", "open_context", "picture_size"]
