"""Forward and inverse kinematics of the legs.

The order of legs is front left, front right, rear left, rear right; the order of joints is hip,
thigh, knee. Positions are relative to the trunk: x forward, y left, z up [m].
"""

import numpy as np
from numpy.typing import NDArray

__all__ = ["HIPS", "LEGS", "foot_jacobians", "foot_positions", "joint_angles"]

Array = NDArray[np.float64]

LEGS = ("fl", "fr", "rl", "rr")
LINK_M = 0.2
"""Length of thigh and shin [m]."""
SIDES = np.array([1.0, -1.0, 1.0, -1.0])
OFFSETS = 0.085 * SIDES
"""Distance from the axis of the hip to the plane of the leg, to the left [m], shape (4,)."""
HIPS = np.array([[0.18, 0.05, 0.0], [0.18, -0.05, 0.0], [-0.18, 0.05, 0.0], [-0.18, -0.05, 0.0]])
"""The axes of the hips [m], shape (4, 3)."""


def foot_positions(angles: Array) -> Array:
    """The centers of the feet [m], shape (4, 3), for joint angles [rad], shape (4, 3)."""
    hip, thigh, knee = angles.T
    x = -LINK_M * (np.sin(thigh) + np.sin(thigh + knee))
    down = -LINK_M * (np.cos(thigh) + np.cos(thigh + knee))
    y = OFFSETS * np.cos(hip) - down * np.sin(hip)
    z = OFFSETS * np.sin(hip) + down * np.cos(hip)
    feet: Array = HIPS + np.column_stack((x, y, z))
    return feet


def joint_angles(feet: Array) -> Array:
    """The joint angles [rad], shape (4, 3), for positions of the feet [m], shape (4, 3).

    If a position is out of reach, the foot gets as close as possible.
    """
    x, y, z = (feet - HIPS).T
    down = -np.sqrt(np.maximum(y**2 + z**2 - OFFSETS**2, 1e-9))
    hip = np.arctan2(z, y) - np.arctan2(down, OFFSETS)
    half_knee = np.arccos(np.clip(np.hypot(x, down) / (2 * LINK_M), 0.0, 1.0))
    thigh = np.arctan2(-x, -down) + half_knee
    return np.column_stack(((hip + np.pi) % (2 * np.pi) - np.pi, thigh, -2 * half_knee))


def foot_jacobians(angles: Array) -> Array:
    """Jacobian of each foot with respect to its joints [m/rad], shape (4, 3, 3)."""
    hip, thigh, knee = angles.T
    x, y, z = (foot_positions(angles) - HIPS).T
    down = -LINK_M * (np.cos(thigh) + np.cos(thigh + knee))
    shin_x, shin_down = -LINK_M * np.cos(thigh + knee), LINK_M * np.sin(thigh + knee)
    of_hip = (np.zeros(4), -z, y)
    of_thigh = (down, x * np.sin(hip), -x * np.cos(hip))
    of_knee = (shin_x, -shin_down * np.sin(hip), shin_down * np.cos(hip))
    return np.stack([np.column_stack(part) for part in (of_hip, of_thigh, of_knee)], axis=-1)
