"""What the quadruped does: it stands up, then sways and trots on the spot by turns.

In: the time and where the trunk is. Out: where the feet are to be, seen from the trunk. No ROS, no
state: the same time and trunk give the same feet.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quadruped_py.legs import HIPS, OFFSETS, joint_angles

__all__ = ["Gait", "Trunk", "wanted_angles", "wanted_feet"]

Array = NDArray[np.float64]

PAIRS = np.array([0.0, np.pi, np.pi, 0.0])
"""Phase of each leg in a trot: the diagonal ones move together [rad]."""
MAX_SPEED = np.array([0.3, 0.3, 0.6])
"""The most that steps correct: forward, to the left [m/s], turning [rad/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gait:
    """The numbers that shape the motion."""

    stand_up_s: float = 2.0
    act_s: float = 6.0
    """How long it sways, and then trots [s]."""
    height_m: float = 0.28
    """From the feet to the hips."""
    trim_m: float = -0.015
    """How far the feet stand before the hips, so that the trunk's weight is between them."""
    sway_m: float = 0.035
    lift_m: float = 0.05
    step_s: float = 0.4
    """Time in which each foot steps once."""
    levelling: float = 0.5
    """Share of the trunk's tilt that the legs take back."""
    homing_hz: float = 2.0
    """Speed of the steps for each metre that the trunk is off its place [1/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trunk:
    """Where the trunk is, in the world: x and y [m], and its rotation matrix, shape (3, 3)."""

    place: Array
    rotation: Array


def wanted_angles(time_s: float, start: Array, trunk: Trunk, gait: Gait) -> Array:
    """The joint angles to be held [rad], shape (4, 3).

    Args:
        time_s: since the beginning, when the joints were at `start` [rad], shape (4, 3).
    """
    risen = smooth(time_s / gait.stand_up_s)
    feet = wanted_feet(max(0.0, time_s - gait.stand_up_s), trunk, gait)
    return (1 - risen) * start + risen * joint_angles(feet)


def wanted_feet(time_s: float, trunk: Trunk, gait: Gait) -> Array:
    """Where the feet are to be, seen from the trunk [m], shape (4, 3), while it stands."""
    act, within_s = divmod(time_s, gait.act_s)
    # Each act fades in and out, so that the feet never jump.
    share = smooth(within_s) * smooth(gait.act_s - within_s)
    feet: Array = HIPS + np.column_stack(
        (np.full(4, gait.trim_m), OFFSETS, np.full(4, -gait.height_m))
    )
    feet += share * (steps(time_s, trunk, gait) if act % 2 else -sway(within_s, gait))
    # A foot whose side of the trunk is low is put further down, which lifts that side.
    feet[:, 2] += gait.levelling * feet[:, :2] @ trunk.rotation[2, :2]
    return feet


def sway(time_s: float, gait: Gait) -> Array:
    """How the trunk moves over its feet [m], shape (3,): a figure of eight."""
    phase = 2 * np.pi * time_s / 3.0
    way: Array = gait.sway_m * np.array([np.sin(2 * phase), np.sin(phase), 0.5 * np.sin(phase)])
    return way


def steps(time_s: float, trunk: Trunk, gait: Gait) -> Array:
    """How the feet move in a trot that brings the trunk back to its place [m], shape (4, 3)."""
    phase = 2 * np.pi * time_s / gait.step_s + PAIRS
    turned = np.arctan2(trunk.rotation[1, 0], trunk.rotation[0, 0])
    off = np.append(trunk.rotation[:2, :2].T @ trunk.place, turned)
    forward, left, turning = np.clip(-gait.homing_hz * off, -MAX_SPEED, MAX_SPEED)
    speeds = np.column_stack((forward - turning * HIPS[:, 1], left + turning * HIPS[:, 0]))
    reach = -np.cos(phase)[:, None] * speeds * gait.step_s / 4
    return np.column_stack((reach, gait.lift_m * np.maximum(0.0, np.sin(phase))))


def smooth(share: float) -> float:
    """From 0 to 1 as the share does, without a jerk at either end."""
    x = min(max(share, 0.0), 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2)
