"""Message definitions as recordings hold them: the text of a `.msg` file and of those it refers to.

Pure. Total in time and size: the text of a file need not be sound.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from obelisk_recordings.bag import RecordingError

__all__ = ["PRIMITIVES", "Field", "MessageDefinition", "parse_definition"]

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
"""Type -> numpy's code of it, without the order of bytes."""
_TIMES: Final = ("builtin_interfaces/Time", "builtin_interfaces/Duration")
_NAME: Final = re.compile(r"[A-Za-z]\w{0,255}")
_UNIT: Final = re.compile(r"\[([^\[\]]{1,40})\]")
_NO_UNIT: Final = re.compile(r"[\d\s,.:x*-]*")
"""What stands in brackets and is a shape or a number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One field of a message."""

    name: str
    kind: str
    """A primitive, `string`, `wstring`, or `pkg/Name`."""
    size: int | None = None
    """Length of an array; None: a single value, or as many as there are."""
    is_sequence: bool = False
    unit: str = ""
    """From the comment, such as `rad/s`; empty if it names none, or several."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageDefinition:
    """A message type with those that it refers to."""

    root: str
    types: Mapping[str, tuple[Field, ...]]
    """`pkg/Name` -> fields."""

    def unit(self, path: str) -> str:
        """The unit of a field by its path; a part without one has that of the whole.

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
    """Read a definition.

    Args:
        name: full name of the type, `pkg/msg/Name` or `pkg/Name`.
        text: fields, then a line of `=`, `MSG: pkg/Name` and fields of each further type.

    Raises:
        RecordingError: a line is no field.
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
    """The field that a line declares; None: it declares a constant."""
    words = code.split(None, 2)
    declared, name = (words[0], words[1]) if len(words) > 1 else (code.strip(), "")
    # `TEXT=1`, or `TEXT = 1`; `<=` stands in bounded types only.
    if "=" in name or (len(words) > 2 and words[2].startswith("=")):
        return None
    if not _NAME.fullmatch(name):
        raise RecordingError(f"the definition of a message has the line `{code.strip()[:80]}`")
    kind, bracket, rest = declared.partition("[")
    size, is_sequence = None, False
    if bracket:
        length = rest.removesuffix("]")
        is_sequence = not length or length.startswith("<=")
        if not is_sequence:
            if not re.fullmatch(r"[0-9]{1,9}", length):
                raise RecordingError(f"the definition of a message has the type `{declared[:80]}`")
            size = int(length)
    kind = kind.partition("<=")[0]  # a bounded string
    if kind not in PRIMITIVES and kind not in ("string", "wstring"):
        kind = _short(kind) if "/" in kind else f"{package}/{kind}"
    return Field(name=name, kind=kind, size=size, is_sequence=is_sequence, unit=_unit(comment))


def _unit(comment: str) -> str:
    """The unit that a comment names.

    `position [m], then orientation` is of several quantities, so it names no unit for the field.
    """
    if re.search(r"\], then ", comment):
        return ""
    units = {unit for unit in _UNIT.findall(comment) if not _NO_UNIT.fullmatch(unit)}
    return units.pop() if len(units) == 1 else ""
