"""Run the simulator as a process: `python -m obelisk_py.core.sim.mujoco --ros-args ...`."""

import importlib
import os

from obelisk_py.core.utils.ros import spin_obelisk

__all__ = ["import_without_windows", "main"]

VARIABLE = "MUJOCO_GL"


def import_without_windows() -> None:
    """Import MuJoCo without GLFW, whose library search starts another Python process.

    This process opens no windows: cameras render off screen with their own back end, and viewers
    run in their own processes. Both use the user's value of MUJOCO_GL.
    """
    chosen = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = "disable"
    try:
        importlib.import_module("mujoco")
    finally:
        if chosen is None:
            del os.environ[VARIABLE]
        else:
            os.environ[VARIABLE] = chosen


import_without_windows()
from obelisk_py.core.sim.mujoco import ObeliskMujocoRobot  # noqa: E402 - MuJoCo comes first


def main() -> None:
    """Spin the simulator until shutdown."""
    spin_obelisk(None, ObeliskMujocoRobot)


if __name__ == "__main__":
    main()
