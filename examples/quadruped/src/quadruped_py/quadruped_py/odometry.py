"""Where the trunk is, from the legs: feet that carry weight stand still, so the trunk moves.

In: one reading of encoders, IMU and feet. Out: position and velocity of the trunk. No ROS.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quadruped_py.legs import foot_jacobians, foot_positions

__all__ = ["Odometry", "Reading", "rotation_matrix"]

Array = NDArray[np.float64]

FOOT_RADIUS_M = 0.022
LEAST_FORCE_N = 5.0
"""Less than this on all feet together: the robot is in the air, or lies."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What the sensors say at one time."""

    angles: Array
    """Of the joints [rad], shape (4, 3)."""
    speeds: Array
    """Of the joints [rad/s], shape (4, 3)."""
    rotation: Array
    """Of the trunk in the world, by the IMU, shape (3, 3)."""
    turning: Array
    """Of the trunk in its own frame, by the gyroscope [rad/s], shape (3,)."""
    forces: Array
    """On the feet [N], shape (4,)."""


@dataclass(slots=True, kw_only=True)
class Odometry:
    """Adds up the trunk's way since the beginning, which is at x = y = 0 on level ground."""

    position: Array
    """Of the trunk in the world [m], shape (3,)."""
    velocity: Array
    """Of the trunk in the world [m/s], shape (3,)."""

    @classmethod
    def at_the_beginning(cls) -> "Odometry":
        """Nothing is known yet."""
        return cls(position=np.zeros(3), velocity=np.zeros(3))

    def update(self, reading: Reading, period_s: float) -> None:
        """Go on by one reading, `period_s` after the last."""
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
    """The matrix, shape (3, 3), of a unit quaternion in the order x, y, z, w."""
    axis, w = quaternion[:3], quaternion[3]
    cross = np.cross(np.eye(3), axis)  # cross @ v == axis x v
    matrix: Array = np.eye(3) + 2 * w * cross + 2 * cross @ cross
    return matrix
