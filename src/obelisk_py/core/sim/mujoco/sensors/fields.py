"""Numbers into the fields of messages.

In: MuJoCo's arrays; its quaternions are `(w, x, y, z)`. Out: fields, by name; arrays of doubles.
"""

from array import array
from typing import Any

from obelisk_py.core.sim.mujoco.sensors.kind import Array

__all__ = ["doubles", "set_quaternion", "set_xyz"]


def doubles(values: Array) -> "array[float]":
    """A copy of numbers in the form that a `float64[]` field keeps as it is.

    Anything else rclpy converts number by number.
    """
    return array("d", values.tobytes())


def set_quaternion(field: Any, wxyz: Array) -> None:
    """Put a quaternion of MuJoCo's, shape `(4,)`, into a `geometry_msgs/Quaternion`."""
    field.w, field.x, field.y, field.z = wxyz.tolist()


def set_xyz(field: Any, xyz: Array) -> None:
    """Put a vector, shape `(3,)`, into a `geometry_msgs/Vector3` or `Point`."""
    field.x, field.y, field.z = xyz.tolist()
