"""The messages of a topic as arrays: by field, by joint, with times, header stamps and units."""

import functools
import importlib
import math
import re
from array import array
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from itertools import islice
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.lockstep.scheduler import NS_PER_S
from obelisk_py.core.lockstep.topics import Topic
from obelisk_py.core.messages import message_name
from obelisk_recordings.layout import unit_in
from obelisk_spec.suggestions import did_you_mean, with_number
from obk_cli.record.recorder import installed_definition
from obk_cli.ros.field_path import field_steps

__all__ = ["Array", "TopicLog", "nested_class"]

__tracebackhide__ = True
"""Makes pytest show the line in the test instead of lines in this module."""

Array = NDArray[Any]
Steps = tuple[str | int, ...]
"""Names of fields and indices in arrays, outermost first."""
_HALF_NS: Final = 0.5e-9
_ARRAY: Final = re.compile(r"sequence<(?P<sequence>.+?)(, \d+)?>|(?P<array>.+)\[\d+\]")
_MESSAGE: Final = re.compile(r"([a-z]\w*)/(\w+)")
"""Types of fields, as rclpy names them."""


class FieldLog:
    """A field that is itself a message; its fields are attributes.

    Converted to an array, it has a row per message and a column per number.
    """

    def __init__(self, log: "TopicLog", steps: Steps, values: Sequence[Any]) -> None:
        """Wrap the values of the field, one per message."""
        self._log = log
        self._steps = steps
        self._values = values

    def __repr__(self) -> str:
        return f"<{self._log.label}.{_path(self._steps)}: {len(self)} messages>"

    def __len__(self) -> int:
        return len(self._values)

    def __iter__(self) -> Iterator[Any]:
        return iter(self._values)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        del copy
        return np.array([list(_numbers(value)) for value in self._values], dtype or float)

    def __getitem__(self, place: Any) -> Any:
        return np.asarray(self)[place]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return self._log.field((*self._steps, name))


class TopicLog:
    """The messages of a topic; `messages.q_joints` is an array with one row per message.

    A nested field is `messages.pose.position.x` or `messages["pose.position.x"]`. The second form
    also works for fields with the name of an attribute of this class, such as `t` or `at`.
    """

    def __init__(
        self,
        label: str,
        message_class: type[Any],
        log: Sequence[tuple[int, int, bytes]],
        unpack: Callable[[bytes], Any],
        on_look: Callable[[tuple[str, ...]], None] = lambda _: None,
        why_unpublished: str | None = None,
    ) -> None:
        """Wrap the messages of a topic.

        Args:
            label: name of the topic.
            message_class: class of the messages.
            log: time of publication [ns], position among all messages, and bytes; messages that are
                added later are ignored.
            unpack: bytes -> message.
            on_look: called with topic and field when a field is read.
            why_unpublished: why the topic has no messages, if that is probably a mistake in the
                test; then reading a field is an error.
        """
        self.label = label
        self.message_class = message_class
        self.unpack = unpack
        self._log = log
        self._count = len(log)
        self._on_look = on_look
        self._why_unpublished = why_unpublished

    @classmethod
    def of(
        cls,
        topic: Topic,
        on_look: Callable[[tuple[str, ...]], None],
        why_unpublished: str | None = None,
    ) -> "TopicLog":
        """Wrap the messages that a topic has logged so far."""
        log, unpack = topic.log or (), topic.codec.unpack
        return cls(topic.label, topic.message_class, log, unpack, on_look, why_unpublished)

    def __repr__(self) -> str:
        return f"<{self.label}: {self._count} messages>"

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Any]:
        return iter(self.messages)

    @cached_property
    def entries(self) -> Sequence[tuple[int, int, bytes]]:
        """Time of publication [ns], position among all messages of the run, bytes."""
        return tuple(islice(self._log, self._count))

    @cached_property
    def t(self) -> Array:
        """Times of publication [s], shape `(n,)`."""
        return np.array([sent_ns for sent_ns, _, _ in self.entries], dtype=np.int64) / NS_PER_S

    @cached_property
    def messages(self) -> Sequence[Any]:
        """The messages."""
        return tuple(self.unpack(data) for _, _, data in self.entries)

    @cached_property
    def stamps(self) -> Array:
        """Times in the headers of the messages [s], shape `(n,)`.

        Raises:
            LookupError: the messages have no header, or no node subscribes to the topic.
        """
        if "header" not in self.message_class.get_fields_and_field_types():
            raise LookupError(f"the messages of {self.label} have no header")
        self._require_published()
        stamps = [message.header.stamp for message in self.messages]
        return np.array([stamp.sec + stamp.nanosec / NS_PER_S for stamp in stamps])

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return self.field((name,))

    def __getitem__(self, path: str) -> Any:
        """Return a field by its path, such as `pose.position.x` or `ranges[0]`.

        Raises:
            LookupError: the messages have no such field.
        """
        steps = field_steps(f".{path}")
        if not steps:
            raise LookupError(
                f"`{path}` is not a field, expected one such as pose.position or ranges[0]"
            )
        try:
            return self.field(steps)
        except AttributeError as error:
            raise LookupError(str(error)) from error

    def field(self, steps: Steps) -> Any:
        """Return the values of a field.

        Args:
            steps: names and indices in arrays, outermost first.

        Returns:
            An array with one row per message; for a field that is itself a message, a `FieldLog`.

        Raises:
            AttributeError: the messages have no such field.
            LookupError: an array in a message is too short, or its length varies; or no node
                subscribes to the topic, so it has no messages.
        """
        self._on_look((self.label, _path(steps)))
        is_message = nested_class(self._kind_of(steps)) is not None
        self._require_published()
        values: list[Any] = list(self.messages)
        for number, step in enumerate(steps):
            if isinstance(step, int):
                values = [self._item(value, step, steps[:number]) for value in values]
            else:
                values = [getattr(value, step) for value in values]
        if is_message:
            return FieldLog(self, steps, values)
        try:
            return np.array(values)
        except ValueError as error:
            raise LookupError(
                f"{self.label}: the length of `{_path(steps)}` varies, so it cannot be an array; "
                "read it from `.messages`"
            ) from error

    def _item(self, value: Any, place: int, steps: Steps) -> Any:
        if place >= len(value):
            raise LookupError(
                f"{self.label}: `{_path(steps)}` has only {with_number(len(value), 'item')}"
            )
        return value[place]

    def _kind_of(self, steps: Steps) -> str:
        """Return the type of a field, as rclpy names it."""
        kind, message_class = "", cast(type[Any] | None, self.message_class)
        for number, step in enumerate(steps):
            before = steps[:number]
            if isinstance(step, int):
                items = _ARRAY.fullmatch(kind)
                if items is None:
                    raise AttributeError(f"{self.label}: `{_path(before)}` is not an array")
                kind = items["sequence"] or items["array"]
            else:
                known = message_class.get_fields_and_field_types() if message_class else {}
                if step not in known:
                    where = f"`{_path(before)}` of {self.label}" if before else self.label
                    help = did_you_mean(step, known) or f"it has {', '.join(known) or 'none'}"
                    raise AttributeError(f"{where} has no field `{step}`: {help}")
                kind = known[step]
            message_class = nested_class(kind)
        return kind

    def _require_published(self) -> None:
        if self._why_unpublished is not None and not self._count:
            raise LookupError(self._why_unpublished)

    def unit(self, field: str) -> str | None:
        """Return the unit of a field, such as `rad/s`; None if its definition has none.

        Args:
            field: its path, such as `q_joints` or `pose.position.x`.
        """
        message_class, unit = self.message_class, None
        for name in re.sub(r"\[\d+\]", "", field).split("."):
            kind = message_class.get_fields_and_field_types().get(name)
            if kind is None:
                return None
            # In a message such as Imu, the vector has the unit, and its `x` has none of its own.
            unit = _unit_of(message_name(message_class), name) or unit
            items = _ARRAY.fullmatch(kind)
            inner = nested_class(kind if items is None else items["sequence"] or items["array"])
            message_class = inner or message_class
        return unit

    def at(self, t: float) -> Any:
        """Return the latest message at a given time [s].

        Raises:
            LookupError: no message was published by then.
            ValueError: the time is NaN.
        """
        if math.isnan(t):
            raise ValueError("the time is nan, expected a number of seconds")
        self._require_published()
        place = int(np.searchsorted(self.t, t + _HALF_NS, side="right")) - 1
        if place < 0:
            raise LookupError(f"{self.label}: no message by {t:g} s")
        return self.unpack(self._log[place][2])

    def joint(self, name: str, field: str) -> Array:
        """Return a field of one joint, looked up by the names in the messages, shape `(n,)`.

        Args:
            name: name of the joint.
            field: an array with one item per joint, such as `q_joints`.

        Raises:
            LookupError: the messages have no such joint, or no node subscribes to the topic.
            AttributeError: the messages have no such field.
        """
        self._require_published()
        first = self.messages[0] if len(self) else None
        names = list(getattr(first, "joint_names", ()) or getattr(first, "name", ()))
        if name not in names:
            help = did_you_mean(name, names) or f"they have {', '.join(names) or 'none'}"
            raise LookupError(f"the messages of {self.label} have no joint `{name}`: {help}")
        column: Array = self[f"{field}[{names.index(name)}]"]
        return column


def nested_class(kind: str) -> type[Any] | None:
    """Return the class of a field that is itself a message; None for any other type.

    Args:
        kind: type of the field, as rclpy names it.
    """
    match = _MESSAGE.fullmatch(kind)
    if match is None:
        return None
    found: type[Any] = getattr(importlib.import_module(f"{match[1]}.msg"), match[2])
    return found


def _path(steps: Steps) -> str:
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps)
    return text.removeprefix(".")


def _numbers(value: Any) -> Iterator[float]:
    """Yield the numbers in a message, including those in arrays, in order."""
    if isinstance(value, bool | int | float | np.number):
        yield float(value)
    elif isinstance(value, np.ndarray | array | list | tuple):
        for item in value:
            yield from _numbers(item)
    elif hasattr(value, "get_fields_and_field_types"):
        for name in value.get_fields_and_field_types():
            yield from _numbers(getattr(value, name))


@functools.cache
def _unit_of(msg_type: str, field: str) -> str:
    """Return the unit in the comment of a field, `[rad]`; empty if it has several or none."""
    package, _, name = msg_type.split("/")
    comment: list[str] = []
    for line in (installed_definition(package, name) or "").splitlines():
        code, _, text = line.partition("#")
        if code.split()[1:2] == [field]:
            return unit_in(" ".join([*comment, text]))
        comment = [] if code.strip() or not line.strip() else [*comment, text]
    return ""
