"""How large a number may be that MuJoCo is given. Arrays in, sentences out."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["LARGEST", "out_of_bounds"]

LARGEST: Final = 1e10
"""MuJoCo takes a number beyond this for a fault and sets every control to zero (mjMAXVAL)."""


def out_of_bounds(field: str, values: NDArray[np.float64]) -> str | None:
    """The first number that is not finite or too large, as "`u_mujoco[1]` is nan"; else None."""
    # Written so that it is false for NaN too.
    in_range = np.abs(values) <= LARGEST
    if in_range.all():
        return None
    index = int(np.flatnonzero(~in_range)[0])
    return f"`{field}[{index}]` is {values[index]:g}"
