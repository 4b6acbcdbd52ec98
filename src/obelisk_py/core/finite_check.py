"""Check that the numbers of a message are finite, or replace them with zeros; for any type.

Only the header is known by its type: it describes the message and is left as it is.
"""

import copy
import math
from array import array
from collections.abc import Iterator
from typing import Any

import numpy as np
from std_msgs.msg import Header

__all__ = ["non_finite_number", "zeroed"]


def non_finite_number(message: Any) -> str | None:
    """The first number that is NaN or infinite, as "`u_mujoco[0]` is nan"; None: all are finite."""
    return next(_non_finite(message, ""), None)


def zeroed(message: Any) -> Any:
    """A copy in which every number is zero; lengths, texts, truth values and headers stay."""
    zeros = type(message)()
    for field, value in _fields(message):
        setattr(zeros, field, _zeroed_value(value))
    return zeros


def _fields(message: Any) -> Iterator[tuple[str, Any]]:
    for field in message.get_fields_and_field_types():
        yield field, getattr(message, field)


def _zeroed_value(value: Any) -> Any:
    if isinstance(value, bool | str | bytes | Header):
        return copy.deepcopy(value)
    if isinstance(value, int | float):
        return type(value)(0)
    if isinstance(value, array):
        return array(value.typecode, bytes(len(value) * value.itemsize))
    if isinstance(value, np.ndarray):
        return np.zeros_like(value)
    if isinstance(value, list):
        return [_zeroed_value(item) for item in value]
    return zeroed(value)


def _non_finite(value: Any, name: str) -> Iterator[str]:
    if isinstance(value, float):
        if not math.isfinite(value):
            yield f"`{name}` is {value:g}"
    elif isinstance(value, array | np.ndarray):
        for place in np.flatnonzero(~np.isfinite(value)):
            yield f"`{name}[{place}]` is {value[place]:g}"
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _non_finite(item, f"{name}[{index}]")
    elif hasattr(value, "get_fields_and_field_types"):
        for field, inner in _fields(value):
            yield from _non_finite(inner, f"{name}.{field}" if name else field)
