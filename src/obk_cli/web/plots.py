"""Subscribe to the fields that pages plot, and keep their latest values.

Pages request fields from their own threads; the thread that follows the stack receives messages.
Values are kept for a while after the last page has closed, so that a reloaded page continues.
"""

import threading
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Any, Final

from obk_cli.clock import monotonic_s
from obk_cli.errors import ObkError
from obk_cli.ros.field_path import (
    ArrayType,
    FieldsOf,
    FieldType,
    Message,
    Number,
    Selection,
    Text,
    check_selection,
    parse_selection,
    parse_type,
    selected,
)
from obk_cli.ros.message_data import columns, plain_data
from obk_cli.ros.participant import RosParticipant
from obk_cli.ros.raw_subscription import RawSubscription, arrived
from obk_cli.ros.types import fields_of, find_type, short_type

__all__ = [
    "MOST_LINES",
    "SHOWN_S",
    "FieldData",
    "FieldRequest",
    "Plots",
    "Sample",
    "Trace",
    "number_fields",
    "numbers_in",
]

SHOWN_S: Final = 30.0
SAMPLES_HZ: Final = 50
MOST_LINES: Final = 12
"""Maximum number of lines in a plot; more cannot be distinguished."""
_NS: Final = 1_000_000_000
_SLOT_NS: Final = _NS // SAMPLES_HZ
_DEEPEST: Final = 4
"""Deepest nesting of the offered fields."""

Sample = tuple[int, tuple[float | None, ...]]
"""Time of receipt [ns since 1970] and a value for each label; None: no value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldRequest:
    """A field that a page plots."""

    topic: str
    """Full name."""
    field: str
    """In the syntax of `obk topic echo`: `q_joints`, `q_joints[0]`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldData:
    """The values of a field, or why there are none."""

    labels: tuple[str, ...]
    """`q_joints[0]`, ...: in the order of the values."""
    samples: tuple[Sample, ...]
    """Oldest first."""
    fault: str
    """Why there are no values; empty if there are some."""


class Trace:
    """The latest values of one field."""

    def __init__(self) -> None:
        """Start without values."""
        self.fault = ""
        """Why there are no values; empty if there are some."""
        self._labels: tuple[str, ...] = ()
        self._samples: deque[Sample] = deque()
        self._slot = -1

    def is_due(self, received_ns: int) -> bool:
        """Whether the next sample is due at this time; messages in between are skipped."""
        return received_ns // _SLOT_NS != self._slot

    def take(self, received_ns: int, numbers: Mapping[str, float]) -> None:
        """Keep a message's numbers, by label."""
        self._slot = received_ns // _SLOT_NS
        self.fault = "" if numbers else "the latest message has no number in this field"
        new = (label for label in numbers if label not in self._labels)
        self._labels += tuple(islice(new, MOST_LINES - len(self._labels)))
        self._samples.append((received_ns, tuple(numbers.get(label) for label in self._labels)))
        while self._samples[0][0] < received_ns - SHOWN_S * _NS:
            self._samples.popleft()

    def data_after(self, after_ns: int) -> FieldData:
        """The samples after a time [ns since 1970]."""
        new = tuple(sample for sample in self._samples if sample[0] > after_ns)
        return FieldData(labels=self._labels, samples=new, fault=self.fault)


def numbers_in(value: Any, field: str) -> dict[str, float]:
    """The first numbers and booleans in a field of a message, by label.

    Args:
        value: a number, an array or a message; `MISSING` has no numbers.
        field: the name of the field.
    """
    first = value[:MOST_LINES] if hasattr(value, "__getitem__") else value
    found = columns(plain_data(first), field)
    numbers = ((label, float(one)) for label, one in found if isinstance(one, int | float))
    return dict(islice(numbers, MOST_LINES))


def number_fields(msg_type: str, fields_of: FieldsOf) -> tuple[str, ...]:
    """The fields of a message type that are worth plotting.

    They are numbers, arrays of numbers, and messages that contain only numbers. Such a message is
    listed before its own fields.

    Args:
        msg_type: `pkg/Name`.
        fields_of: looks up the fields of types.
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


KEPT_S: Final = 5.0
"""How long a field keeps its subscription after the last page has closed [s]."""


class _Plot:
    """A field with its subscription and the number of pages that plot it."""

    def __init__(self) -> None:
        self.trace = Trace()
        self.pages = 0
        self.left_s = 0.0
        self.raw: RawSubscription | None = None
        self.selection: Selection | None = None


class Plots:
    """The fields that open pages are plotting."""

    def __init__(self) -> None:
        """Start without values."""
        self._lock = threading.Lock()
        self._plots: dict[FieldRequest, _Plot] = {}
        self._participant: RosParticipant | None = None

    @contextmanager
    def subscribed(self, requests: Sequence[FieldRequest]) -> Iterator[None]:
        """Subscribe to these fields inside the `with` block."""
        with self._lock:
            for request in requests:
                self._plots.setdefault(request, _Plot()).pages += 1
        try:
            yield
        finally:
            with self._lock:
                for request in requests:
                    self._plots[request].pages -= 1
                    self._plots[request].left_s = monotonic_s()

    def data_after(self, request: FieldRequest, after_ns: int) -> FieldData:
        """The data of a subscribed field after a time [ns since 1970]."""
        with self._lock:
            return self._plots[request].trace.data_after(after_ns)

    def turn(self, participant: RosParticipant) -> None:
        """Process received messages; call this several times per second.

        Args:
            participant: a participant in the stack's domain; a new one means another stack.
        """
        with self._lock:
            self._drop_unused()
            plots = list(self._plots.items())
            if participant is not self._participant:
                self._participant = participant
                for _, plot in plots:
                    plot.raw = None
        for request, plot in plots:
            try:
                self._listen(participant, request, plot)
                if plot.raw is not None and plot.selection is not None:
                    self._take(request, plot, plot.raw, plot.selection)
            except ObkError as error:
                plot.trace.fault = "; ".join(filter(None, (error.message, error.help)))

    def _drop_unused(self) -> None:
        expired_s = monotonic_s() - KEPT_S
        for request, plot in list(self._plots.items()):
            if not plot.pages and plot.left_s < expired_s:
                if plot.raw is not None:
                    plot.raw.close()
                del self._plots[request]

    def _listen(self, participant: RosParticipant, request: FieldRequest, plot: _Plot) -> None:
        """Subscribe as soon as the topic has a type, and adapt to new publishers."""
        if plot.raw is not None:
            plot.raw.refresh()
            return
        msg_type = next(iter(participant.topic(request.topic).msg_types), None)
        if msg_type is None:
            plot.trace.fault = "no node currently publishes or subscribes to this topic"
            return
        plot.selection = parse_selection(request.field)
        kind = check_selection(plot.selection, short_type(msg_type), fields_of)
        if isinstance(kind.item if isinstance(kind, ArrayType) else kind, Text):
            plot.trace.fault = f"`{request.field}` contains text, not numbers"
            return
        plot.raw = participant.subscribe(request.topic, msg_type, find_type(msg_type))
        plot.trace.fault = ""

    def _take(
        self, request: FieldRequest, plot: _Plot, raw: RawSubscription, selection: Selection
    ) -> None:
        for received_ns, message in arrived(raw, plot.trace.is_due):
            numbers = numbers_in(selected(message, selection), request.field)
            with self._lock:
                plot.trace.take(received_ns, numbers)
