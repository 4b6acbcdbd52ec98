"""Runs the simulator as a process: `python -m obelisk_py.core.sim.mujoco --ros-args ...`."""

import importlib
import os

from obelisk_py.core.utils.ros import spin_obelisk

__all__ = ["import_without_windows", "main"]

VARIABLE = "MUJOCO_GL"


def import_without_windows() -> None:
    """Import MuJoCo without GLFW, whose search for its library starts another Python.

    This process opens no window: cameras draw off screen with a back end of their own, and viewers
    are processes of their own. Both see MUJOCO_GL as the user has set it.
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
    """Spin the simulator until it is asked to end."""
    spin_obelisk(None, ObeliskMujocoRobot)


if __name__ == "__main__":
    main()
