"""Check values of a config against their type and limits."""

import sys
from collections.abc import Mapping
from typing import Final, Literal, TypeGuard

__all__ = [
    "COUNT_RANGE",
    "LARGEST_COUNT",
    "LONGEST_PERIOD_S",
    "PERIOD_RANGE",
    "SHORTEST_PERIOD_S",
    "OnCrash",
    "ParameterValue",
    "is_count",
    "is_mapping",
    "is_none",
    "is_number",
    "is_period",
    "is_text",
    "is_whole",
]

LARGEST_COUNT: Final = 2**31 - 1
"""Largest 32-bit count, for DDS depths, MuJoCo sizes and device numbers.

Source: OMG, Data Distribution Service 1.4, HistoryQosPolicy; MuJoCo, mjModel.
"""

SHORTEST_PERIOD_S: Final = 1e-9
LONGEST_PERIOD_S: Final = 9e9
"""ROS represents time as 64-bit nanoseconds [s]."""


ParameterValue = (
    bool
    | int
    | float
    | str
    | tuple[bool, ...]
    | tuple[int, ...]
    | tuple[float, ...]
    | tuple[str, ...]
)

OnCrash = Literal["stop", "restart", "ignore"]
"""What happens when a node crashes or hangs: the values of `on_crash`."""


COUNT_RANGE: Final = f"a whole number from 1 to {LARGEST_COUNT}"
"""The values that `is_count` accepts, as text for messages."""
PERIOD_RANGE: Final = f"a number of seconds greater than 0 and at most {LONGEST_PERIOD_S:g}"
"""The values that `is_period` accepts, as text for messages."""
_LARGEST: Final = sys.float_info.max


def is_number(
    value: object, least: float = -_LARGEST, most: float = _LARGEST
) -> TypeGuard[int | float]:
    """Whether it is an int or a float within the limits; booleans are not numbers."""
    return isinstance(value, int | float) and not isinstance(value, bool) and least <= value <= most


def is_whole(value: object, least: int, most: int) -> TypeGuard[int]:
    """Whether it is an int within the limits; booleans are not numbers."""
    return isinstance(value, int) and is_number(value, least, most)


def is_count(value: object) -> TypeGuard[int]:
    """Whether it is an int from 1 to `LARGEST_COUNT`."""
    return is_whole(value, 1, LARGEST_COUNT)


def is_period(value: object) -> TypeGuard[int | float]:
    """Whether it is a period [s] greater than 0 and at most `LONGEST_PERIOD_S`."""
    return is_number(value, most=LONGEST_PERIOD_S) and value > 0


def is_text(value: object) -> TypeGuard[str]:
    """Whether it is a non-empty string."""
    return isinstance(value, str) and bool(value)


def is_none(value: object) -> bool:
    """Whether it is the word `None` in any case, which a config uses for "not set"."""
    return isinstance(value, str) and value.lower() == "none"


def is_mapping(value: object) -> TypeGuard[Mapping[str, object]]:
    """Whether it is a mapping with only string keys; YAML allows others."""
    return isinstance(value, Mapping) and all(isinstance(key, str) for key in value)
