"""Check the arguments of a test's actions, so that a mistake fails the test, not a node."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["LONGEST_S", "require_duration", "require_number", "require_time", "require_vector"]

LONGEST_S: Final = 1e8
"""Longer times are mistakes, except for infinity where it is allowed [s]."""


def require_number(name: str, value: float, *, most: float = math.inf) -> None:
    """Check that a number is from 0 to `most`.

    Raises:
        ValueError: it is not, or it is NaN.
    """
    if not 0.0 <= value <= most:
        limits = "at least 0" if most == math.inf else f"from 0 to {most:g}"
        raise ValueError(f"{name} is {value}, expected a number {limits}")


def require_duration(seconds: float) -> None:
    """Check that a duration is positive; infinity is allowed.

    Raises:
        ValueError: it is not.
    """
    if not seconds > 0.0:
        raise ValueError(f"the duration is {seconds}, expected a number of seconds greater than 0")


def require_time(name: str, seconds: float) -> None:
    """Check that a time is finite and not negative.

    Raises:
        ValueError: it is not.
    """
    if not 0.0 <= seconds <= LONGEST_S:
        raise ValueError(
            f"{name} is {seconds}, expected a number of seconds from 0 to {LONGEST_S:g}"
        )


def require_vector(name: str, vector: Sequence[float] | NDArray[np.float64]) -> None:
    """Check that a vector has three finite numbers.

    Raises:
        ValueError: it does not.
    """
    if len(vector) != 3 or not all(map(math.isfinite, vector)):
        raise ValueError(f"{name} is {list(vector)}, expected three finite numbers")
