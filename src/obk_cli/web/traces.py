"""The newest values of fields that a page draws, thinned out as they come. Pure.

In: numbers with the time of receipt. Out: those of the last 30 s, at most 50 a second.
"""

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Any, Final

from obk_cli.introspect.field_path import (
    ArrayType,
    FieldsOf,
    FieldType,
    Message,
    Number,
    parse_type,
)
from obk_cli.introspect.message_dict import columns, plain_data

__all__ = [
    "MOST_LINES",
    "SHOWN_S",
    "Heard",
    "Sample",
    "Trace",
    "Wish",
    "number_fields",
    "numbers_in",
]

SHOWN_S: Final = 30.0
SAMPLES_HZ: Final = 50
MOST_LINES: Final = 12
"""Of one field: more cannot be told apart."""
_NS: Final = 1_000_000_000
_SLOT_NS: Final = _NS // SAMPLES_HZ
_DEEPEST: Final = 4
"""Levels of messages within messages that are offered."""

Sample = tuple[int, tuple[float | None, ...]]
"""When it came [ns since 1970], and a value for each label; None: there was none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """A field that somebody wants to see."""

    topic: str
    """Full name."""
    field: str
    """As `obk topic echo` takes it: `q_joints`, `q_joints[0]`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Heard:
    """What came of a field."""

    labels: tuple[str, ...]
    """`q_joints[0]`, ...: in the order of the values."""
    samples: tuple[Sample, ...]
    """Oldest first."""
    fault: str
    """Why nothing comes; empty: nothing is wrong."""


class Trace:
    """The newest values of one field."""

    def __init__(self) -> None:
        """Begin with none."""
        self.fault = ""
        """Why nothing comes; empty: nothing is wrong."""
        self._labels: tuple[str, ...] = ()
        self._samples: deque[Sample] = deque()
        self._slot = -1

    def is_due(self, received_ns: int) -> bool:
        """Whether a message is wanted, or enough came just before it."""
        return received_ns // _SLOT_NS != self._slot

    def take(self, received_ns: int, numbers: Mapping[str, float]) -> None:
        """Keep a message's numbers, by label."""
        self._slot = received_ns // _SLOT_NS
        self.fault = "" if numbers else "the newest message has no number there"
        new = (label for label in numbers if label not in self._labels)
        self._labels += tuple(islice(new, MOST_LINES - len(self._labels)))
        self._samples.append((received_ns, tuple(numbers.get(label) for label in self._labels)))
        while self._samples[0][0] < received_ns - SHOWN_S * _NS:
            self._samples.popleft()

    def heard(self, after_ns: int) -> Heard:
        """What came after a time [ns since 1970]."""
        new = tuple(sample for sample in self._samples if sample[0] > after_ns)
        return Heard(labels=self._labels, samples=new, fault=self.fault)


def numbers_in(value: Any, field: str) -> dict[str, float]:
    """The first numbers and truth values in a field of a message, by label.

    Args:
        value: a number, an array, a message; `MISSING` has none.
        field: its name.
    """
    first = value[:MOST_LINES] if hasattr(value, "__getitem__") else value
    found = columns(plain_data(first), field)
    numbers = ((label, float(one)) for label, one in found if isinstance(one, int | float))
    return dict(islice(numbers, MOST_LINES))


def number_fields(msg_type: str, fields_of: FieldsOf) -> tuple[str, ...]:
    """The fields of a message type that are worth drawing.

    Numbers, arrays of numbers and, before what is in them, messages of nothing but numbers.

    Args:
        msg_type: `pkg/Name`.
        fields_of: where types are looked up.
    """
    return tuple(_number_fields(Message(msg_type), "", fields_of, 0))


def _number_fields(kind: FieldType, name: str, fields_of: FieldsOf, depth: int) -> Iterator[str]:
    match kind:
        case Number() | ArrayType(Number()):
            yield name
        case Message(inner) if depth < _DEEPEST:
            kinds = {field: parse_type(text) for field, text in fields_of(inner).items()}
            if name and kinds and all(isinstance(one, Number) for one in kinds.values()):
                yield name
            for field, below in kinds.items():
                full = f"{name}.{field}" if name else field
                yield from _number_fields(below, full, fields_of, depth + 1)
