"""Runs the simulator as a process: `python -m obelisk_py.core.sim.mujoco --ros-args ...`."""

from obelisk_py.core.sim.mujoco import ObeliskMujocoRobot
from obelisk_py.core.utils.ros import spin_obelisk

__all__ = ["main"]


def main() -> None:
    """Spin the simulator until it is asked to end."""
    spin_obelisk(None, ObeliskMujocoRobot)


if __name__ == "__main__":
    main()
