"""Messages of generated packages as plain data: objects, lists, numbers, texts.

Out come only values that JSON and CSV know. Imports no message package and no numpy.
"""

from collections.abc import Iterator, Mapping
from typing import Any

__all__ = ["Plain", "columns", "plain_data"]

Plain = None | bool | int | float | str | list["Plain"] | dict[str, "Plain"]


def plain_data(value: Any) -> Plain:
    """A message, or a value of one of its fields."""
    fields: Mapping[str, str] | None = (
        value.get_fields_and_field_types() if hasattr(value, "get_fields_and_field_types") else None
    )
    if fields is not None:
        return {name: plain_data(getattr(value, name)) for name in fields}
    if isinstance(value, bytes):  # an octet
        return value[0]
    if isinstance(value, list | tuple):
        return [plain_data(item) for item in value]
    # Arrays of numbers, and the numbers of numpy's arrays.
    plain: Plain = value.tolist() if hasattr(value, "tolist") else value
    return plain


def columns(value: Plain, name: str) -> Iterator[tuple[str, Plain]]:
    """The single values in it with their names, as in `header.stamp.sec`, `q_joints[0]`.

    Args:
        value: plain data.
        name: its own; empty for a whole message.
    """
    if isinstance(value, dict):
        for field, item in value.items():
            yield from columns(item, f"{name}.{field}" if name else field)
    elif isinstance(value, list):
        for place, item in enumerate(value):
            yield from columns(item, f"{name}[{place}]")
    else:
        yield name, value
