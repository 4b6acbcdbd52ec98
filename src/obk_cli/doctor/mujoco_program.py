"""Step and draw a tiny scene with the back end of MUJOCO_GL; a program.

Run as `python -P -m obk_cli.doctor.mujoco_program`; prints one JSON object a step, so
that the first is reported even if OpenGL then kills the process.
"""

import importlib
import json
import signal
from typing import Final

import mujoco

__all__ = ["main"]

LONGEST_S: Final = 15
SCENE: Final = """
<mujoco>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="1 1 .1" rgba="1 1 1 1"/>
    <body pos="0 0 .5"><freejoint/><geom size=".2" rgba="1 0 0 1"/></body>
  </worldbody>
</mujoco>
"""


def main() -> None:
    """Step, then draw."""
    signal.alarm(LONGEST_S)
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 10)
    print(json.dumps({"stepped": data.time > 0}), flush=True)
    with mujoco.Renderer(model, 48, 64) as renderer:
        renderer.update_scene(data)
        picture = renderer.render()
        drawn = int(picture.min()) < int(picture.max())
        print(json.dumps({"drawn": drawn, "renderer": _renderer_name()}), flush=True)


def _renderer_name() -> str:
    """What draws, as OpenGL says; empty where it is reached past PyOpenGL."""
    try:
        gl = importlib.import_module("OpenGL.GL")
    except ImportError:
        return ""
    name = gl.glGetString(gl.GL_RENDERER)
    return name.decode() if name else ""


if __name__ == "__main__":
    main()
