"""The motion of the quadruped: it stands up, then alternately sways and trots on the spot.

It computes the desired positions of the feet relative to the trunk, from the time and the pose of
the trunk. It does not use ROS and has no state: the same time and trunk give the same feet.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quadruped_py.legs import HIPS, OFFSETS, joint_angles

__all__ = ["Gait", "Trunk", "desired_angles", "desired_feet"]

Array = NDArray[np.float64]

PAIRS = np.array([0.0, np.pi, np.pi, 0.0])
"""Phase of each leg in a trot, in which diagonal legs move together [rad]."""
MAX_SPEED = np.array([0.3, 0.3, 0.6])
"""Maximum speeds of corrective steps: forward, to the left [m/s], turning [rad/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gait:
    """The parameters of the motion."""

    stand_up_s: float = 2.0
    act_s: float = 6.0
    """Duration of swaying and of trotting [s]."""
    height_m: float = 0.28
    """Height of the hips above the feet."""
    trim_m: float = -0.015
    """Distance of the feet in front of the hips, which centers the trunk's weight over them."""
    sway_m: float = 0.035
    lift_m: float = 0.05
    step_s: float = 0.4
    """Duration of one step of each foot."""
    levelling: float = 0.5
    """Fraction of the trunk's tilt that the legs correct."""
    homing_hz: float = 2.0
    """Speed of the steps per meter of distance of the trunk from its start [1/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trunk:
    """Pose of the trunk in the world: x and y [m], and its rotation matrix, shape (3, 3)."""

    place: Array
    rotation: Array


def desired_angles(time_s: float, start: Array, trunk: Trunk, gait: Gait) -> Array:
    """The desired joint angles [rad], shape (4, 3).

    Args:
        time_s: time since the start, when the joints were at `start` [rad], shape (4, 3).
    """
    risen = smooth(time_s / gait.stand_up_s)
    feet = desired_feet(max(0.0, time_s - gait.stand_up_s), trunk, gait)
    return (1 - risen) * start + risen * joint_angles(feet)


def desired_feet(time_s: float, trunk: Trunk, gait: Gait) -> Array:
    """The desired positions of the feet relative to the trunk [m], shape (4, 3)."""
    act, within_s = divmod(time_s, gait.act_s)
    # Each act fades in and out, so that the feet never jump.
    share = smooth(within_s) * smooth(gait.act_s - within_s)
    feet: Array = HIPS + np.column_stack(
        (np.full(4, gait.trim_m), OFFSETS, np.full(4, -gait.height_m))
    )
    feet += share * (steps(time_s, trunk, gait) if act % 2 else -sway(within_s, gait))
    # Lower the feet on the low side of the trunk, which lifts that side.
    feet[:, 2] += gait.levelling * feet[:, :2] @ trunk.rotation[2, :2]
    return feet


def sway(time_s: float, gait: Gait) -> Array:
    """The motion of the trunk over its feet [m], shape (3,): a figure of eight."""
    phase = 2 * np.pi * time_s / 3.0
    way: Array = gait.sway_m * np.array([np.sin(2 * phase), np.sin(phase), 0.5 * np.sin(phase)])
    return way


def steps(time_s: float, trunk: Trunk, gait: Gait) -> Array:
    """The motion of the feet in a trot that returns the trunk to its start [m], shape (4, 3)."""
    phase = 2 * np.pi * time_s / gait.step_s + PAIRS
    turned = np.arctan2(trunk.rotation[1, 0], trunk.rotation[0, 0])
    off = np.append(trunk.rotation[:2, :2].T @ trunk.place, turned)
    forward, left, turning = np.clip(-gait.homing_hz * off, -MAX_SPEED, MAX_SPEED)
    speeds = np.column_stack((forward - turning * HIPS[:, 1], left + turning * HIPS[:, 0]))
    reach = -np.cos(phase)[:, None] * speeds * gait.step_s / 4
    return np.column_stack((reach, gait.lift_m * np.maximum(0.0, np.sin(phase))))


def smooth(share: float) -> float:
    """Map a fraction from 0 to 1 to a smooth transition from 0 to 1."""
    x = min(max(share, 0.0), 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2)
