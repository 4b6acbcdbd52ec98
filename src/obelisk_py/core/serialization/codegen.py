"""Generate the functions that write, read and copy a message, as Python source.

Calling a function for each field takes twice as long. So each CDR type consists of source lines.
The function of a message class joins the lines of its fields, and is compiled when it is first
used. To see the source, print `codec_for(message_class).source`.

In these lines, `$value` and `$target` are the fields that are read from and assigned to, separated
by commas if a type covers several. Every other `$name` is a value in the type's `names`. `out`,
`data` and `at` are the arguments described at `Functions`; all other variables are free.
"""

import functools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any, Final, NamedTuple, cast

import numpy as np

__all__ = ["CdrType", "Functions", "Locate", "NumberField", "Source", "functions_of"]

_NAME: Final = re.compile(r"\$(\w+)")


class NumberField(NamedTuple):
    """The location of one field's numbers in a serialized message."""

    name: str
    """`header.stamp.sec`, `joint_pos`, `markers.2.scale.x`."""
    start: int
    """Position of the first number."""
    dtype: np.dtype[Any]
    size: int
    """Number of numbers."""
    is_stamp: bool = False
    """Whether it is the `sec` of a `builtin_interfaces/Time`."""

    @property
    def end(self) -> int:
        """Position after the last number."""
        return self.start + self.size * self.dtype.itemsize


Locate = Callable[[bytes, int, Sequence[str], list[NumberField]], int]
"""Appends the locations of the named fields' numbers; returns the position after the fields."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CdrType:
    """The type of one field, or of several fields that are written together."""

    write: str
    """Lines that append `$value` to `out`, after the padding before it."""
    read: str
    """Lines that assign the value at the position `at` to `$target`, and advance `at`."""
    copy: str
    """Lines that assign to `$target` what writing `$value` and reading it back would return."""
    names: Mapping[str, Any]
    locate: Locate


class Functions(NamedTuple):
    """The generated functions of a type or of a message class."""

    write: Callable[[bytearray, Any], None]
    """Appends a value and the padding before it."""
    read: Callable[[bytes, int], tuple[Any, int]]
    """Returns the value at a position, and the position after it."""
    copy: Callable[[Any], Any]
    """Returns what writing the value and reading it back would return."""


class Source:
    """The source of the three functions, and the values of the names in it.

    In all of them, `m0` is the value that is written or copied, and `n0` is the new value.
    """

    def __init__(self) -> None:
        """Start without lines."""
        self.write: list[str] = []
        self.read: list[str] = []
        self.copy: list[str] = []
        self._names: dict[str, Any] = {}

    def name(self, value: Any, stem: str) -> str:
        """Return the name of a value in the source, `stem_1` or the next number."""
        names = (f"{stem}_{number}" for number in count(1))
        return next(name for name in names if self._names.setdefault(name, value) is value)

    def add(self, cdr_type: CdrType, values: str, targets: str) -> None:
        """Add the lines of a type.

        Args:
            cdr_type: the type.
            values: the values to write and to copy, separated by commas.
            targets: what is assigned when reading and copying, separated by commas.
        """
        names = {stem: self.name(value, stem) for stem, value in cdr_type.names.items()}
        names |= {"value": values, "target": targets}

        def lines_of(text: str) -> list[str]:
            lines = _NAME.sub(lambda match: names[match[1]], text).splitlines()
            return [line for line in lines if line.strip()]

        self.write += lines_of(cdr_type.write)
        self.read += lines_of(cdr_type.read)
        self.copy += lines_of(cdr_type.copy)

    def text(self, function: str) -> str:
        """Return the source of a function by its name in `Functions`."""
        head, lines, result = {
            "write": ("write(out, m0)", self.write, "None"),
            "read": ("read(data, at)", self.read, "n0, at"),
            "copy": ("copy(m0)", self.copy, "n0"),
        }[function]
        return "\n    ".join([f"def {head}:", *lines, f"return {result}"])

    def compiled(self, function: str) -> Callable[..., Any]:
        """Compile a function by its name in `Functions`."""
        # The text contains slots of generated classes, and nothing that a user wrote.
        exec(self.text(function), self._names)
        return cast(Callable[..., Any], self._names[function])

    def functions(self) -> Functions:
        """Compile all functions."""
        return Functions(*map(self.compiled, Functions._fields))


@functools.cache
def functions_of(cdr_type: CdrType, *, fields: int = 1) -> Functions:
    """Compile the functions of a type by itself.

    Args:
        cdr_type: the type.
        fields: number of fields that it covers; if several, only the last value is returned.
    """
    source = Source()
    source.read.append("n0 = None")  # the byte of a message without fields has no value
    source.add(cdr_type, "m0", ", ".join(["n0"] * fields))
    return source.functions()
