"""Dataclasses read back from JSON that anybody may have written.

In: a dataclass and what JSON gave. Out: its value, or None where a field is missing or of another
type. Fields that this version does not know are passed over. Reads no file.
"""

import math
from collections.abc import Mapping
from dataclasses import is_dataclass
from functools import cache
from types import UnionType
from typing import Any, Final, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

__all__ = ["value_of"]

T = TypeVar("T")

LARGEST_INTEGER: Final = 2**63 - 1


def value_of(kind: type[T], data: object) -> T | None:
    """The dataclass that JSON data describe, field by field; None: they describe none."""
    try:
        value: T = _read(kind, data)
    except (TypeError, OverflowError):
        return None
    return value


@cache
def _types_of(kind: type[Any]) -> Mapping[str, Any]:
    return get_type_hints(kind)


def _read(kind: Any, data: Any) -> Any:
    """The value of this type.

    Raises:
        TypeError: it is of another one.
        OverflowError: a number is too large.
    """
    if is_dataclass(kind):
        return _read_fields(kind, data)
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return None if data is None and type(None) in arguments else _read(arguments[0], data)
    if origin is tuple and isinstance(data, list):
        return tuple(_read(arguments[0], item) for item in data)
    if origin is Mapping and isinstance(data, dict):
        return {key: _read(arguments[1], item) for key, item in data.items()}
    if origin is Literal and data in arguments:
        return data
    is_number = isinstance(data, int | float) and not isinstance(data, bool)
    if kind is float and is_number and math.isfinite(data):
        return float(data)
    if kind is int and is_number and isinstance(data, int) and abs(data) <= LARGEST_INTEGER:
        return data
    if kind in (str, bool) and isinstance(data, kind):
        return data
    raise TypeError(f"no {kind}")


def _read_fields(kind: Any, data: Any) -> Any:
    if not isinstance(data, dict):
        raise TypeError("no object")
    types = _types_of(kind).items()
    return kind(**{name: _read(field, data[name]) for name, field in types if name in data})
