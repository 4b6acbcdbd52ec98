"""Locate the fields of serialized messages, once for all messages of the same layout.

Messages are CDR, as ROS 2 writes them. Messages of equal length whose arrays and strings have equal
lengths have the same layout, so their fields are columns of one table of bytes.
Source: OMG DDS-RTPS 2.5, 10.2 (encapsulation); OMG CORBA 3.4, 15.3 (alignment, strings, sequences).
"""

import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from obelisk_recordings.bag import RecordingError

__all__ = [
    "HEADER",
    "PRIMITIVES",
    "Bytes",
    "Column",
    "MessageDefinition",
    "MessageLayout",
    "layout_of",
    "parse_definition",
    "unit_in",
]


PRIMITIVES: Final = {
    "bool": "?",
    "byte": "u1",
    "char": "u1",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float32": "f4",
    "float64": "f8",
}
"""Type -> numpy's type code, without the byte order."""
HEADER: Final = "std_msgs/Header"
"""The type whose `stamp` is a time of the clock that the publishing node uses."""
_TIMES: Final = ("builtin_interfaces/Time", "builtin_interfaces/Duration")
_NAME: Final = re.compile(r"[A-Za-z]\w{0,255}")
_UNIT: Final = re.compile(r"\[([^\[\]]{1,40})\]")
_NO_UNIT: Final = re.compile(r"[\d\s,.:x*-]*")
"""Matches text in brackets that is a shape or a number, not a unit."""
Bytes = NDArray[np.uint8]
HEAD_BYTES: Final = 4
"""Size of the header of each message, which gives the byte order."""
_ORDERS: Final = {b"\0\0": ">", b"\0\1": "<"}
_DEEPEST: Final = 32
"""Maximum depth of nested messages."""
_MOST_COLUMNS: Final = 10_000
"""Maximum number of fields of a message, including those in arrays of messages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One field of a message."""

    name: str
    kind: str
    """A primitive, `string`, `wstring`, or `pkg/Name`."""
    size: int | None = None
    """Length of an array; None for a single value or a sequence."""
    is_sequence: bool = False
    unit: str = ""
    """Unit in the comment, such as `rad/s`; empty if there are none or several."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageDefinition:
    """A message type and the types that it refers to."""

    root: str
    types: Mapping[str, tuple[Field, ...]]
    """`pkg/Name` -> fields."""

    def unit(self, path: str) -> str:
        """Return the unit of a field; a part without a unit has that of the whole.

        Args:
            path: such as `angular_velocity.x` or `q_joints[0]`.
        """
        kind, unit = self.root, ""
        for name in re.sub(r"\[\d+\]", "", path).split("."):
            field = next((one for one in self.types.get(kind, ()) if one.name == name), None)
            if field is None:
                return unit
            kind, unit = field.kind, field.unit or unit
        return unit


def parse_definition(name: str, text: str) -> MessageDefinition:
    """Parse a message definition.

    Args:
        name: full name of the type, `pkg/msg/Name` or `pkg/Name`.
        text: fields; then for each further type, a line of `=`, `MSG: pkg/Name` and its fields.

    Raises:
        RecordingError: a line is not a field.
    """
    root = _short(name)
    types: dict[str, tuple[Field, ...]] = {}
    current, fields, comment = root, list[Field](), list[str]()
    for line in text.splitlines():
        code, _, remark = line.partition("#")
        if code.startswith("==="):
            continue
        if code.startswith("MSG:"):
            types.setdefault(current, tuple(fields))
            current, fields, comment = _short(code[4:].strip()), [], []
            continue
        if not code.strip():
            comment = [*comment, remark] if remark else []
            continue
        field = _field(code, " ".join([*comment, remark]), current.partition("/")[0])
        comment = []
        if field is not None:
            fields.append(field)
    types.setdefault(current, tuple(fields))
    for each in _TIMES:
        parts = Field(name="sec", kind="int32"), Field(name="nanosec", kind="uint32")
        types.setdefault(each, parts)
    return MessageDefinition(root=root, types=types)


def _short(name: str) -> str:
    """`pkg/msg/Name` -> `pkg/Name`."""
    parts = name.split("/")
    return f"{parts[0]}/{parts[-1]}"


def _field(code: str, comment: str, package: str) -> Field | None:
    """Parse the field that a line declares; None if it declares a constant."""
    words = code.split(None, 2)
    declared, name = (words[0], words[1]) if len(words) > 1 else (code.strip(), "")
    # `TEXT=1`, or `TEXT = 1`; `<=` only occurs in bounded types.
    if "=" in name or (len(words) > 2 and words[2].startswith("=")):
        return None
    if not _NAME.fullmatch(name):
        raise RecordingError(f"invalid line in a message definition: `{code.strip()[:80]}`")
    kind, bracket, rest = declared.partition("[")
    size, is_sequence = None, False
    if bracket:
        length = rest.removesuffix("]")
        is_sequence = not length or length.startswith("<=")
        if not is_sequence:
            if not re.fullmatch(r"[0-9]{1,9}", length):
                raise RecordingError(f"invalid type in a message definition: `{declared[:80]}`")
            size = int(length)
    kind = kind.partition("<=")[0]  # a bounded string
    if kind not in PRIMITIVES and kind not in ("string", "wstring"):
        kind = _short(kind) if "/" in kind else f"{package}/{kind}"
    return Field(name=name, kind=kind, size=size, is_sequence=is_sequence, unit=unit_in(comment))


def unit_in(comment: str) -> str:
    """Return the unit that a comment gives; empty if there is none, or several.

    `position [m], then orientation` describes several quantities, so it does not give the field a
    unit.
    """
    if re.search(r"\], then ", comment):
        return ""
    units = {unit for unit in _UNIT.findall(comment) if not _NO_UNIT.fullmatch(unit)}
    return units.pop() if len(units) == 1 else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """One field in all messages of a layout."""

    path: str
    """Such as `header.stamp.sec`, `q_joints` or `parts[0].x`."""
    code: str
    """numpy's type code of its numbers, with the byte order; empty for strings."""
    offset: int = 0
    """Offset of the first number [bytes]."""
    count: int | None = None
    """Number of items in an array; None if it is not an array."""
    texts: tuple[tuple[int, int], ...] = ()
    """Start and end of each string [bytes]."""

    def read(self, rows: Bytes) -> NDArray[np.generic]:
        """Return the values, shape `(n,)` or `(n, count)`; numbers are a view of the bytes.

        Args:
            rows: the messages, shape `(n, bytes)`.
        """
        if self.code:
            numbers = 1 if self.count is None else self.count
            size = np.dtype(self.code).itemsize
            part = rows[:, self.offset : self.offset + numbers * size]
            values = part.view(self.code) if numbers else np.empty((len(rows), 0), self.code)
            return values[:, 0] if self.count is None else values
        texts = np.empty((len(rows), len(self.texts)), object)
        for place, (start, end) in enumerate(self.texts):
            part = rows[:, start:end]
            if (part == part[:1]).all():
                texts[:, place] = _text(part[0]) if len(part) else ""
            else:
                texts[:, place] = [_text(row) for row in part]
        return texts[:, 0] if self.count is None else texts


def _text(data: Bytes) -> str:
    return data.tobytes().decode(errors="replace")


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageLayout:
    """The locations of all fields, for messages with the same lengths."""

    columns: dict[str, Column]
    """Columns by path, in the order of the definition."""
    lengths: tuple[tuple[int, bytes], ...]
    """Offset and bytes of everything that determines the layout."""
    stamps: tuple[int, ...]
    """Offset of the stamp of each header, also of those inside fields [bytes]."""

    def fits(self, rows: Bytes) -> NDArray[np.bool_]:
        """Return which messages have this layout, shape `(n,)`; they must have its length."""
        fits = np.ones(len(rows), bool)
        for offset, data in self.lengths:
            code = f"u{len(data)}"
            found = rows[:, offset : offset + len(data)].view(code)[:, 0]
            fits &= found == np.frombuffer(data, code)[0]
        return fits


def layout_of(definition: MessageDefinition, message: bytes) -> MessageLayout:
    """Locate the fields of a message.

    Raises:
        RecordingError: the message is shorter than its definition requires, or is not in a format
            that ROS 2 writes.
    """
    return _Walk(definition, message).layout()


@dataclass(slots=True)
class _Walk:
    """One pass through a message."""

    definition: MessageDefinition
    message: bytes
    order: str = "<"
    offset: int = HEAD_BYTES
    columns: dict[str, Column] = field(default_factory=dict)
    lengths: list[tuple[int, bytes]] = field(default_factory=list)
    stamps: list[int] = field(default_factory=list)

    def layout(self) -> MessageLayout:
        head = self.message[:2]
        if len(self.message) < HEAD_BYTES or head not in _ORDERS:
            raise RecordingError("a message is not in the format that ROS 2 writes (CDR)")
        self.order = _ORDERS[head]
        self.lengths.append((0, head))
        if self.definition.types.get(self.definition.root):  # an empty message has a padding byte
            self._message(self.definition.root, "", 0)
        return MessageLayout(
            columns=self.columns, lengths=tuple(self.lengths), stamps=tuple(self.stamps)
        )

    def _message(self, kind: str, path: str, depth: int) -> None:
        fields = self.definition.types.get(kind)
        if fields is None:
            raise RecordingError(f"the recording does not define the message `{kind[:80]}`")
        if depth > _DEEPEST:
            raise RecordingError(f"the message `{kind[:80]}` contains itself")
        if not fields:
            self._skip(1)
        for each in fields:
            if kind == HEADER and each.name == "stamp":
                self._align(4)
                self.stamps.append(self.offset)
            self._field(each, f"{path}.{each.name}" if path else each.name, depth)

    def _field(self, each: Field, path: str, depth: int) -> None:
        count = self._length() if each.is_sequence else each.size
        if each.kind in PRIMITIVES:
            self._numbers(each.kind, path, count)
        elif each.kind == "string":
            texts = tuple(self._string() for _ in range(self._bounded(count)))
            self._add(Column(path=path, code="", count=count, texts=texts))
        elif each.kind == "wstring":
            raise RecordingError(f"`{path}` is a `wstring`, which cannot be read")
        elif count is None:
            self._message(each.kind, path, depth + 1)
        else:
            for place in range(self._bounded(count)):
                self._message(each.kind, f"{path}[{place}]", depth + 1)

    def _bounded(self, count: int | None) -> int:
        """Return the number of items, each of which takes at least one byte."""
        number = 1 if count is None else count
        if number > len(self.message) - self.offset:
            raise self._broken(number)
        return number

    def _numbers(self, kind: str, path: str, count: int | None) -> None:
        code = PRIMITIVES[kind]
        size = 1 if code == "?" else int(code[1])
        if count != 0:
            self._align(size)
        order = self.order if size > 1 else ""
        column = Column(path=path, code=f"{order}{code}", offset=self.offset, count=count)
        self._skip(size * (1 if count is None else count))
        self._add(column)

    def _string(self) -> tuple[int, int]:
        length = self._length()
        start = self.offset
        self._skip(length)
        return start, max(start, self.offset - 1)  # without the terminating zero

    def _length(self) -> int:
        self._align(4)
        start = self.offset
        self._skip(4)
        data = self.message[start : self.offset]
        self.lengths.append((start, data))
        (length,) = struct.unpack(f"{self.order}I", data)
        return int(length)

    def _align(self, size: int) -> None:
        self.offset += -(self.offset - HEAD_BYTES) % size

    def _skip(self, size: int) -> None:
        if self.offset + size > len(self.message):
            raise self._broken(size)
        self.offset += size

    def _broken(self, size: int) -> RecordingError:
        left = max(0, len(self.message) - self.offset)
        return RecordingError(f"a message is damaged: expected {size} bytes, only {left} are left")

    def _add(self, column: Column) -> None:
        if len(self.columns) == _MOST_COLUMNS:
            raise RecordingError(f"a message has more than {_MOST_COLUMNS} fields")
        self.columns[column.path] = column
