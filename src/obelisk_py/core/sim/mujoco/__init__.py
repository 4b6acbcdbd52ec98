"""MuJoCo in place of the robot."""

from obelisk_py.core.sim.mujoco.robot import ObeliskMujocoRobot

__all__ = ["ObeliskMujocoRobot"]
