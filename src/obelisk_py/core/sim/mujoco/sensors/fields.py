"""Numbers from MuJoCo's arrays into those of packed messages.

In: views of messages' numbers and MuJoCo's arrays, whose quaternions are `(w, x, y, z)` where those
of messages are `(x, y, z, w)`. Out: calls that copy what the arrays hold by then.
"""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.sim.mujoco.sensors.kind import Array

__all__ = ["Copy", "copy_all", "copy_picked", "copy_quaternion", "in_turn", "set_quaternion"]

Copy = Callable[[], None]


def copy_all(numbers: NDArray[Any], source: Array) -> Copy:
    """Copies an array, shape `(n,)`."""

    def copy() -> None:
        numbers[:] = source

    return copy


def copy_picked(numbers: NDArray[Any], source: Array, index: NDArray[np.intp]) -> Copy:
    """Copies the elements of an array that an index, shape `(n,)`, picks."""
    if (np.diff(index) == 1).all():
        return copy_all(numbers, source[index[0] : index[-1] + 1])

    def copy() -> None:
        numbers[:] = source[index]

    return copy


def copy_quaternion(xyzw: NDArray[Any], wxyz: Array) -> Copy:
    """Copies a quaternion of MuJoCo's into a message's."""
    return in_turn((copy_all(xyzw[:3], wxyz[1:]), copy_all(xyzw[3:], wxyz[:1])))


def in_turn(copies: Iterable[Copy]) -> Copy:
    """One call for several."""
    calls = tuple(copies)

    def copy() -> None:
        for call in calls:
            call()

    return copy


def set_quaternion(xyzw: NDArray[Any], wxyz: Array) -> None:
    """Put a quaternion of MuJoCo's into the numbers of a `geometry_msgs/Quaternion`."""
    xyzw[:3] = wxyz[1:]
    xyzw[3] = wxyz[0]
