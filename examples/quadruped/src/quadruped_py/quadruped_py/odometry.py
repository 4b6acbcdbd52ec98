"""Estimate the motion of the trunk from the legs, because feet that carry weight do not move.

It computes position and velocity of the trunk from readings of encoders, IMU and feet. It does not
use ROS.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quadruped_py.legs import foot_jacobians, foot_positions

__all__ = ["Odometry", "Reading", "rotation_matrix"]

Array = NDArray[np.float64]

FOOT_RADIUS_M = 0.022
LEAST_FORCE_N = 5.0
"""Total force on all feet below which the robot is in the air or lying on the ground."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """The sensor values at one time."""

    angles: Array
    """Joint angles [rad], shape (4, 3)."""
    speeds: Array
    """Joint speeds [rad/s], shape (4, 3)."""
    rotation: Array
    """Rotation matrix of the trunk in the world, from the IMU, shape (3, 3)."""
    turning: Array
    """Angular velocity of the trunk in its frame, from the gyroscope [rad/s], shape (3,)."""
    forces: Array
    """Forces on the feet [N], shape (4,)."""


@dataclass(slots=True, kw_only=True)
class Odometry:
    """Integrates the motion of the trunk, which starts at x = y = 0 on level ground."""

    position: Array
    """Position of the trunk in the world [m], shape (3,)."""
    velocity: Array
    """Velocity of the trunk in the world [m/s], shape (3,)."""

    @classmethod
    def at_start(cls) -> "Odometry":
        """The state before the first reading."""
        return cls(position=np.zeros(3), velocity=np.zeros(3))

    def update(self, reading: Reading, period_s: float) -> None:
        """Add one reading, `period_s` after the previous one."""
        weight = reading.forces.sum()
        if weight < LEAST_FORCE_N:
            return
        feet = foot_positions(reading.angles)
        moving = np.einsum("fij,fj->fi", foot_jacobians(reading.angles), reading.speeds)
        moving += np.cross(reading.turning, feet)
        share = reading.forces / weight
        self.velocity = -reading.rotation @ (share @ moving)
        self.position = self.position + period_s * self.velocity
        self.position[2] = FOOT_RADIUS_M - reading.rotation[2] @ (share @ feet)


def rotation_matrix(quaternion: Array) -> Array:
    """The rotation matrix, shape (3, 3), of a unit quaternion in the order x, y, z, w."""
    axis, w = quaternion[:3], quaternion[3]
    cross = np.cross(np.eye(3), axis)  # cross @ v == axis x v
    matrix: Array = np.eye(3) + 2 * w * cross + 2 * cross @ cross
    return matrix
