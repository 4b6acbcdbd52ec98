"""The MuJoCo simulator, which replaces the robot."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from obelisk_py.core.sim.mujoco.robot import ObeliskMujocoRobot

__all__ = ["ObeliskMujocoRobot"]


def __getattr__(name: str) -> Any:
    """Import the robot on first use, because viewer processes do not need ROS."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.robot"), name)
