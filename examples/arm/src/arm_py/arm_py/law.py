"""The control law of the arm: the path from pose to pose, and gravity compensation.

It does not use ROS. Vectors have one element per joint, from the table to the hand.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

__all__ = ["Gravity", "Motion", "smoothed"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """A motion that visits all poses repeatedly, and rests at each."""

    start: Array
    """Initial joint angles [rad], shape (6,)."""
    poses: Array
    """Joint angles of the poses [rad], shape (n, 6)."""
    move_s: float
    rest_s: float

    def at(self, time_s: float) -> tuple[Array, Array]:
        """The desired joint angles [rad] and speeds [rad/s].

        The path between two poses is a polynomial that starts and ends with zero speed and
        acceleration (minimum jerk).
        """
        leg, within_s = divmod(time_s, self.move_s + self.rest_s)
        last, goal = int(leg) - 1, self.poses[int(leg) % len(self.poses)]
        origin = self.start if last < 0 else self.poses[last % len(self.poses)]
        x = min(within_s / self.move_s, 1.0)
        share = x**3 * (10 - 15 * x + 6 * x**2)
        share_per_s = 30 * x**2 * (1 - x) ** 2 / self.move_s
        return origin + share * (goal - origin), share_per_s * (goal - origin)


class Gravity:
    """Computes the torques that compensate gravity, with a model of the arm."""

    def __init__(self, model: Path) -> None:
        """Read the model."""
        self._model = mujoco.MjModel.from_xml_path(str(model))
        self._data = mujoco.MjData(self._model)

    def torques(self, angles: Array) -> Array:
        """The torques that hold the joints still [N m], shape (6,)."""
        self._data.qpos[:] = angles
        mujoco.mj_forward(self._model, self._data)
        torques: Array = self._data.qfrc_bias.copy()
        return torques


def smoothed(last: Array, measured: Array, period_s: float, time_constant_s: float) -> Array:
    """Apply one step of a first-order low-pass filter.

    If time went back, as simulated time does at a reset, the value does not change.
    """
    share = 1 - math.exp(-max(period_s, 0.0) / time_constant_s)
    return last + share * (measured - last)
