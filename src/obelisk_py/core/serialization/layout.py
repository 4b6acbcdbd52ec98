"""The layout of a message class: a sequence of parts, each with one CDR type.

On the wire, fields of nested messages follow each other as if they belonged to the outer message.
So a message is one sequence of fields. Only messages in lists have their own layout.
"""

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from itertools import groupby
from typing import Any, Final, NamedTuple

from builtin_interfaces.msg import Time
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractString,
    AbstractType,
    Array,
    BasicType,
    BoundedSequence,
    BoundedString,
    NamespacedType,
    UnboundedString,
)

from obelisk_py.core.serialization.cdr_types import (
    BYTE_DTYPES,
    FORMATS,
    UNLIMITED,
    empty_struct,
    flag,
    list_of,
    numbers,
    numbers_array,
    numbers_sequence,
    strings,
    text,
)
from obelisk_py.core.serialization.codegen import (
    CdrType,
    Functions,
    Locate,
    NumberField,
    Source,
    functions_of,
)

__all__ = ["Layout", "Part", "UnsupportedError", "layout_of", "locate_numbers"]

_OCTET: Final = "octet"
_BOOLEAN: Final = "boolean"
_ARRAY_TYPES: Final = FORMATS.keys() - {_OCTET}
_SECONDS: Final = "_sec"


class UnsupportedError(Exception):
    """A message class has a field whose type is not supported (`wstring`)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """Consecutive fields that are written together by one CDR type."""

    fields: tuple[str, ...]
    """Full names in the message, `header.stamp.sec`; a single one, except for numbers."""
    types: tuple[str, ...]
    """Type names as in the definition, `int32`, `sequence<string>`."""
    stamps: tuple[int, ...]
    """Indices of the fields that are the `sec` of a `builtin_interfaces/Time`."""
    cdr_type: CdrType


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """The wire layout of a message class."""

    parts: tuple[Part, ...]
    source: Source
    """The functions that write, read and copy a message."""


def layout_of(message_class: type[Any]) -> Layout:
    """Compute the layout of a message class.

    Raises:
        UnsupportedError: a field has an unsupported type.
    """
    source = Source()
    numbers_of = _add_messages(source, message_class)
    parts: list[Part] = []
    for are_numbers, group in groupby(_fields(message_class, ""), key=_is_number):
        for fields in [tuple(group)] if are_numbers else [(field,) for field in group]:
            part = _part(fields)
            parts.append(part)
            slots = [_slot_of(field, numbers_of) for field in fields if field.kind is not None]
            source.add(
                part.cdr_type,
                ", ".join(f"m{slot}" for slot in slots),
                ", ".join(f"n{slot}" for slot in slots),
            )
    return Layout(parts=tuple(parts), source=source)


def locate_numbers(
    parts: Sequence[Part], data: bytes, at: int, prefix: str, found: list[NumberField]
) -> int:
    """Locate the numbers in a serialized message.

    Args:
        parts: parts of the message's class.
        data: the whole message.
        at: position of the first part.
        prefix: prefix of the names, such as `markers.2.`.
        found: receives a `NumberField` for each field with numbers.

    Returns:
        The position after the last part.
    """
    for part in parts:
        before = len(found)
        at = part.cdr_type.locate(data, at, [prefix + field for field in part.fields], found)
        for index in part.stamps:
            found[before + index] = found[before + index]._replace(is_stamp=True)
    return at


class _Field(NamedTuple):
    path: str
    """Path of slot names, `_header._stamp._sec`."""
    kind: AbstractType | None
    """None for the single byte of a message without fields."""
    spelling: str
    is_stamp: bool = False
    """Whether it is the `sec` of a `builtin_interfaces/Time`."""

    @property
    def name(self) -> str:
        """Full name, `header.stamp.sec`."""
        return ".".join(slot.removeprefix("_") for slot in self.path.split("."))


def _fields(message_class: type[Any], prefix: str) -> Iterator[_Field]:
    """Yield every field; a nested message is replaced by its fields."""
    fields = _slots(message_class)
    if not fields:
        yield _Field(prefix, None, "")
    for field in fields:
        if isinstance(field.kind, NamespacedType):
            yield from _fields(_class_of(field.kind), f"{prefix}{field.path}.")
        else:
            is_stamp = message_class is Time and field.path == _SECONDS
            yield field._replace(path=prefix + field.path, is_stamp=is_stamp)


def _slots(message_class: type[Any]) -> list[_Field]:
    # The last slot is rclpy's own.
    types = message_class.get_fields_and_field_types().values()
    columns = zip(message_class.__slots__, message_class.SLOT_TYPES, types, strict=False)
    return [_Field(*column) for column in columns]


def _class_of(kind: NamespacedType) -> type[Any]:
    return getattr(import_module(".".join(kind.namespaces)), kind.name)  # type: ignore[no-any-return]


def _is_number(field: _Field) -> bool:
    return isinstance(field.kind, BasicType) and field.kind.typename in FORMATS


def _part(fields: Sequence[_Field]) -> Part:
    return Part(
        fields=tuple(field.name for field in fields if field.kind is not None),
        types=tuple(field.spelling for field in fields if field.kind is not None),
        stamps=tuple(index for index, field in enumerate(fields) if field.is_stamp),
        cdr_type=_cdr_type_of_fields(fields),
    )


def _cdr_type_of_fields(fields: Sequence[_Field]) -> CdrType:
    field = fields[0]
    if field.kind is None:
        return empty_struct()
    if _is_number(field):
        return numbers(tuple(FORMATS[field.spelling] for field in fields))
    try:
        return _cdr_type(field.kind)
    except UnsupportedError as error:
        raise UnsupportedError(f"the field `{field.name}`: {error}") from error


def _cdr_type(kind: AbstractType) -> CdrType:
    if isinstance(kind, AbstractNestedType):
        return _cdr_type_of_list(kind)
    if isinstance(kind, AbstractString):
        return text(kind.maximum_size if isinstance(kind, BoundedString) else UNLIMITED)
    if isinstance(kind, BasicType) and kind.typename == _BOOLEAN:
        return flag()
    if isinstance(kind, BasicType) and kind.typename == _OCTET:
        return numbers((FORMATS[_OCTET],))
    raise UnsupportedError(f"{type(kind).__name__} is not supported")


def _cdr_type_of_list(kind: AbstractNestedType) -> CdrType:
    element = kind.value_type
    most = kind.maximum_size if isinstance(kind, BoundedSequence) else UNLIMITED
    if isinstance(element, BasicType) and element.typename in _ARRAY_TYPES:
        code = FORMATS[element.typename]
        return (
            numbers_array(code, kind.size)
            if isinstance(kind, Array)
            else numbers_sequence(code, most)
        )
    one, locate_one = _element(element)
    byte_dtype = BYTE_DTYPES.get(element.typename) if isinstance(element, BasicType) else None
    if isinstance(kind, Array):
        return list_of(one, locate_one, least=kind.size, most=kind.size, byte_dtype=byte_dtype)
    if isinstance(element, UnboundedString):
        return strings(most)
    return list_of(one, locate_one, most=most, byte_dtype=byte_dtype)


def _element(kind: AbstractType) -> tuple[Callable[[], Functions], Locate]:
    if not isinstance(kind, NamespacedType):
        cdr_type = _cdr_type(kind)
        return functools.partial(functions_of, cdr_type), cdr_type.locate
    layout = layout_of(_class_of(kind))

    def locate(data: bytes, at: int, names: Sequence[str], found: list[NumberField]) -> int:
        return locate_numbers(layout.parts, data, at, f"{names[0]}.", found)

    return functools.cache(layout.source.functions), locate


def _add_messages(source: Source, message_class: type[Any]) -> dict[str, int]:
    """Number a message and its nested messages; return the numbers by path, `_header._stamp`.

    In the source, `m` is the message that is written or copied, and `n` is the new one. It is built
    without its constructor, which would first create a default for every field.
    """
    numbers_of: dict[str, int] = {}
    for path, kind in _messages(message_class, ""):
        number = numbers_of[path] = len(numbers_of)
        new = f"{source.name(kind.__new__, 'new')}({source.name(kind, kind.__name__)})"
        flags = f"n{number}._check_fields = {kind()._check_fields}"
        if path:
            outer, _, slot = path.rpartition(".")
            outer_number = numbers_of[outer]
            nested = f"m{number} = m{outer_number}.{slot}"
            source.write.append(nested)
            source.copy.append(nested)
            new = f"n{outer_number}.{slot} = {new}"
        for lines in (source.read, source.copy):
            lines += [f"n{number} = {new}", flags]
    return numbers_of


def _messages(message_class: type[Any], path: str) -> Iterator[tuple[str, type[Any]]]:
    """Yield a message class and those of the nested messages, with their paths."""
    yield path, message_class
    for field in _slots(message_class):
        if isinstance(field.kind, NamespacedType):
            inner = f"{path}.{field.path}" if path else field.path
            yield from _messages(_class_of(field.kind), inner)


def _slot_of(field: _Field, numbers_of: Mapping[str, int]) -> str:
    """Return a field's place in the source, after `m` or `n`: `2._sec`."""
    path, _, slot = field.path.rpartition(".")
    return f"{numbers_of[path]}.{slot}"
