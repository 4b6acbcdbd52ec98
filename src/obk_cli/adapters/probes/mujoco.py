"""MuJoCo's back ends, each tried in a process of its own: OpenGL may crash whoever loads it."""

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Final

from obk_cli.adapters.probes.child import python_command, told_in_json, try_program
from obk_cli.doctor.mujoco import BACK_ENDS, DrawingTrial, MujocoFacts
from obk_cli.optional_deps import distribution_version
from obk_cli.workspace.model_reader import has_mujoco

__all__ = ["probe_mujoco"]

PROGRAM: Final = "obk_cli.adapters.probes.mujoco_program"
DRAW_S: Final = 20.0


def probe_mujoco() -> MujocoFacts:
    """Step and draw a tiny scene with every back end."""
    chosen = os.environ.get("MUJOCO_GL", "").lower()
    has_display = bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    trials: dict[str, DrawingTrial] = {}
    if has_mujoco():
        with ThreadPoolExecutor(len(BACK_ENDS)) as pool:
            trials = dict(zip(BACK_ENDS, pool.map(_draw, BACK_ENDS), strict=True))
    return MujocoFacts(
        version=distribution_version("mujoco") if has_mujoco() else None,
        chosen=chosen,
        has_display=has_display,
        back_ends=trials,
    )


def _draw(back_end: str) -> DrawingTrial:
    variables = {**os.environ, "MUJOCO_GL": back_end, "PYOPENGL_PLATFORM": back_end}
    if back_end == "glfw":
        del variables["PYOPENGL_PLATFORM"]
    trial = try_program(python_command(PROGRAM), timeout_s=DRAW_S, variables=variables)
    told = told_in_json(trial)
    return DrawingTrial(
        trial=trial,
        has_stepped=bool(told.get("stepped")),
        has_drawn=bool(told.get("drawn")),
        renderer=str(told.get("renderer", "")),
    )
