"""The messages of a recorded topic as arrays: by field, by joint, with times and units."""

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from obelisk_recordings.bag import RecordingError
from obelisk_recordings.chunks import TopicMessages
from obelisk_recordings.layout import Bytes, Column, MessageLayout, layout_of, parse_definition
from obelisk_spec.suggestions import did_you_mean, list_names

__all__ = ["MessageTable", "RecordedField", "RecordedSignal", "RecordedTopic"]

Array = NDArray[Any]
CONTROLS: Final = "u_mujoco"
"""The field with a number per actuator of the model; messages name neither these nor units."""
NS_PER_S: Final = 1_000_000_000
_NAMES: Final = ("joint_names", "name")
"""Fields with the joint names for the other arrays of a message."""
_ELEMENT: Final = re.compile(r"(?P<path>.+)\[(?P<element>[^\[\]]+)\]")
_PLACE: Final = re.compile(r"[0-9]{1,9}")
MessageTable = tuple[MessageLayout, NDArray[np.intp], Bytes]
"""Messages of one layout: the layout, their indices in the topic, their bytes."""


class RecordedSignal:
    """A single number of a topic over time."""

    def __init__(self, topic: "RecordedTopic", path: str, place: int | None, label: str) -> None:
        """Refer to a number without reading it."""
        self.topic = topic
        self.path = path
        """Path of the field, such as `q_joints`."""
        self.place = place
        """Index in the field's array; None if it is not an array."""
        self.label = label
        """Name for display: `q_joints[knee]`."""

    @property
    def unit(self) -> str:
        """Unit, such as `rad/s`; empty if none is known."""
        return self.topic.unit(self.path, self.place)

    def values(self) -> NDArray[np.float64]:
        """Read the numbers, shape `(n,)`; NaN for messages whose array is shorter."""
        return self.topic.numbers(self.path, self.place)


class RecordedField:
    """A field that is itself a message; its fields are attributes: `imu.angular_velocity.x`.

    Converted to an array, it has a row per message and a column per number.
    """

    def __init__(self, topic: "RecordedTopic", path: str) -> None:
        self._topic = topic
        self._path = path

    def __repr__(self) -> str:
        return f"<{self._topic.name}.{self._path}: {len(self._topic)} messages>"

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return self._topic._attribute(f"{self._path}.{name}")

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        del copy
        columns = [one.values() for one in self._topic.signals(self._path)]
        return np.stack(columns, axis=1).astype(dtype or float, copy=False)


class RecordedTopic:
    """The messages of a topic; `est.q_joints` is an array with one row per message.

    A nested field is `imu.angular_velocity.x` or `imu["angular_velocity.x"]`. The second form also
    works for fields with the name of an attribute of this class, such as `t` or `name`.
    """

    def __init__(
        self,
        messages: TopicMessages,
        origin_ns: int = 0,
        actuators: Sequence[tuple[str, str]] = (),
    ) -> None:
        """Wrap the messages of a topic.

        Args:
            messages: the serialized messages.
            origin_ns: origin of times [ns since 1970].
            actuators: name and unit of each number in `u_mujoco`; empty if unknown.
        """
        self.messages = messages
        self.name = messages.topic
        self.msg_type = messages.msg_type
        self._origin_ns = origin_ns
        self._actuators = actuators

    def __repr__(self) -> str:
        return f"<{self.name}: {len(self)} messages>"

    def __len__(self) -> int:
        return len(self.messages)

    @cached_property
    def t(self) -> NDArray[np.float64]:
        """Times of publication since the activation of the stack [s], shape `(n,)`."""
        return (self.messages.published_ns - self._origin_ns) / NS_PER_S

    @cached_property
    def received(self) -> NDArray[np.float64]:
        """Times of receipt since the activation of the stack [s], shape `(n,)`."""
        return (self.messages.received_ns - self._origin_ns) / NS_PER_S

    @cached_property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Times in the headers of the messages [ns], shape `(n,)`.

        Raises:
            RecordingError: the messages have no header.
        """
        seconds = self["header.stamp.sec"].astype(np.int64)
        return np.asarray(seconds * NS_PER_S + self["header.stamp.nanosec"], np.int64)

    @cached_property
    def stamps(self) -> NDArray[np.float64]:
        """Times in the headers of the messages [s], shape `(n,)`.

        Raises:
            RecordingError: the messages have no header.
        """
        return self.stamps_ns / NS_PER_S

    @cached_property
    def fields(self) -> tuple[str, ...]:
        """Paths of all fields with numbers or strings, in the order of the definition."""
        return tuple(dict.fromkeys(path for one, _, _ in self.tables for path in one.columns))

    @cached_property
    def _definition(self) -> Any:
        if not self.messages.definition:
            raise RecordingError(
                f"{self.name} cannot be decoded: its messages are not in the ROS 2 format, or "
                "their definition is missing"
            )
        return parse_definition(self.messages.msg_type, self.messages.definition)

    @cached_property
    def tables(self) -> Sequence[MessageTable]:
        """The messages by layout."""
        return tuple(self._split())

    def _split(self) -> Iterator[MessageTable]:
        for places, rows in self.messages.tables:
            while len(rows):
                layout = layout_of(self._definition, rows[0].tobytes())
                fits = layout.fits(rows)
                if fits.all():
                    yield layout, places, rows
                    break
                yield layout, places[fits], rows[fits]
                places, rows = places[~fits], rows[~fits]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return self._attribute(name)

    def _attribute(self, path: str) -> Any:
        try:
            return self[path]
        except RecordingError as error:
            raise AttributeError(str(error)) from error

    def __getitem__(self, path: str) -> Any:
        """Return a field by its path, such as `pose.position.x`, `q_joints[0]` or `q_joints[knee]`.

        Returns:
            An array with one row per message, of shape `(n,)` or `(n, length)`; if the length
            varies, an array of arrays. For a field that is itself a message, a `RecordedField`.

        Raises:
            RecordingError: the messages have no such field.
        """
        if path in self.fields:
            return self._column(path)
        if any(one.startswith((f"{path}.", f"{path}[")) for one in self.fields):
            return RecordedField(self, path)
        element = self._element(path)
        if element is None:
            raise self._unknown(path)
        return self._place(*element)

    def _element(self, path: str) -> tuple[str, int] | None:
        """Return the array and the index in `q_joints[0]` or `q_joints[knee]`; None if unknown."""
        match = _ELEMENT.fullmatch(path)
        if match is None or match["path"] not in self.fields:
            return None
        if _PLACE.fullmatch(match["element"]):
            return match["path"], int(match["element"])
        names = self.names(match["path"])
        if match["element"] not in names:
            return None
        return match["path"], names.index(match["element"])

    def _column(self, path: str) -> Array:
        found = [
            (places, layout.columns[path].read(rows))
            for layout, places, rows in self.tables
            if path in layout.columns
        ]
        if len(found) == 1 and len(found[0][0]) == len(self):
            (values,) = (values for _, values in found)
            return values.astype(values.dtype.newbyteorder("="), copy=False)
        if len({values.shape[1:] for _, values in found}) == 1:
            return _placed(len(self), found)
        ragged = np.empty(len(self), object)
        for places, values in found:
            for place, row in zip(places, values, strict=True):
                ragged[place] = row
        return ragged

    def _place(self, path: str, place: int) -> Array:
        columns = [layout.columns.get(path) for layout, _, _ in self.tables]
        lengths = {column.count for column in columns if column is not None}
        longest = max((length for length in lengths if length is not None), default=None)
        if longest is None:
            raise RecordingError(f"{self.name}: `{path}` is not an array")
        if place >= longest:
            raise RecordingError(f"{self.name}: `{path}` has only {longest} items")
        if len(lengths) == 1 and None not in columns:
            return np.asarray(self._column(path)[:, place])
        return self.numbers(path, place)

    def _unknown(self, path: str) -> RecordingError:
        names = list(dict.fromkeys(re.split(r"[.\[]", one)[0] for one in self.fields))
        array = path.rpartition("[")[0]
        elements = self.names(array) if array in self.fields else ()
        near = [*names, *self.fields, *(f"{array}[{name}]" for name in elements)]
        return RecordingError(
            f"{self.name} has no field `{path}`",
            help=did_you_mean(path, near) or f"it has {list_names(names)}",
        )

    def numbers(self, path: str, place: int | None) -> NDArray[np.float64]:
        """Return one number per message, shape `(n,)`; NaN for messages without it.

        Args:
            path: path of a field of numbers.
            place: index in the field's array; None if it is not an array.
        """
        numbers = np.full(len(self), np.nan)
        for layout, places, rows in self.tables:
            column = layout.columns.get(path)
            if column is None or (place or 0) >= (1 if column.count is None else column.count):
                continue
            values = column.read(rows)
            numbers[places] = values if place is None else values[:, place]
        return numbers

    def matrix(self, path: str, width: int) -> NDArray[np.float64]:
        """Return the first numbers of a field, shape `(n, width)`; missing ones are NaN.

        It is faster than one call per number.

        Args:
            path: path of a field of numbers.
            width: number of columns; 1 for a field that is not an array.
        """
        numbers = np.full((len(self), width), np.nan)
        for layout, places, rows in self.tables:
            column = layout.columns.get(path)
            if column is not None:
                values = column.read(rows)
                values = values[:, None] if column.count is None else values[:, :width]
                numbers[places, : values.shape[1]] = values
        return numbers

    def long_arrays(self, most: int) -> dict[str, Column]:
        """Return the fields with more than `most` numbers, each with its longest column."""
        found: dict[str, Column] = {}
        for layout, _, _ in self.tables:
            for path, column in layout.columns.items():
                length = column.count or 0
                is_longest = path not in found or length > (found[path].count or 0)
                if column.code and length > most and is_longest:
                    found[path] = column
        return found

    def signals(self, path: str = "", *, without: Collection[str] = ()) -> Iterator[RecordedSignal]:
        """Yield each number in a field as a signal; without a path, those of all fields.

        Args:
            path: path of a field, or of an item of an array; empty: all fields.
            without: fields to leave out.

        Raises:
            RecordingError: the messages have no such field, or it contains only strings.
        """
        found = [one for one in self.fields if _is_part(one, path)]
        element = None if found else self._element(path)
        if element is not None:
            self._place(*element)
            yield from (one for one in self.signals(element[0]) if one.place == element[1])
            return
        if not found:
            raise self._unknown(path)
        if not self._have_numbers(found):
            where = f"{self.name}: `{path}`" if path else self.name
            raise RecordingError(f"{where} contains no numbers")
        for one in found:
            columns = [table[0].columns[one] for table in self.tables if one in table[0].columns]
            if not columns[0].code or one in without:
                continue  # strings
            if columns[0].count is None:
                yield RecordedSignal(self, one, None, one)
                continue
            names = self.names(one)
            for place in range(max(column.count or 0 for column in columns)):
                name = (names[place] if place < len(names) else "") or str(place)
                yield RecordedSignal(self, one, place, f"{one}[{name}]")

    @property
    def has_numbers(self) -> bool:
        """Whether a field contains numbers."""
        return self._have_numbers(self.fields)

    def _have_numbers(self, paths: Iterable[str]) -> bool:
        every = [layout.columns for layout, _, _ in self.tables]
        return any(each[path].code for each in every for path in paths if path in each)

    def unit(self, path: str, place: int | None = None) -> str:
        """Return the unit of a field, such as `rad/s`; empty if there is none, or several.

        Args:
            path: path of the field.
            place: index in the field's array; None for all its numbers.
        """
        if self._are_controls(path):
            units = {unit for _, unit in self._actuators}
            if place is not None:
                return self._actuators[place][1]
            return units.pop() if len(units) == 1 else ""
        return str(self._definition.unit(path))

    def _are_controls(self, path: str) -> bool:
        """Whether a field has a number for each known actuator."""
        if path != CONTROLS or not self._actuators:
            return False
        counts = {table[0].columns[path].count for table in self.tables if path in table[0].columns}
        return counts == {len(self._actuators)}

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """The joint names in the first message that has any; empty if none has."""
        for field in _NAMES:
            for layout, _, rows in self.tables:
                column = layout.columns.get(field)
                if column is not None and column.texts and column.count:
                    return tuple(map(str, column.read(rows[:1])[0]))
        return ()

    def names(self, path: str) -> tuple[str, ...]:
        """Return the names for a field with one number per joint or actuator; empty for others."""
        if "." in path or path in _NAMES:
            return ()
        if self._are_controls(path):
            return tuple(name for name, _ in self._actuators)
        counts = {table[0].columns[path].count for table in self.tables if path in table[0].columns}
        return self.joint_names if counts == {len(self.joint_names)} else ()

    def joint(self, name: str, field: str) -> Array:
        """Return a field of one joint, looked up by the names in the messages, shape `(n,)`.

        Args:
            name: name of the joint.
            field: an array with one number per joint, such as `q_joints`.

        Raises:
            RecordingError: the messages have no such joint or field.
        """
        names = self.joint_names
        if name not in names:
            raise RecordingError(
                f"the messages of {self.name} have no joint `{name}`",
                help=did_you_mean(name, names) or f"they have {list_names(names) or 'none'}",
            )
        return np.asarray(self[f"{field}[{names.index(name)}]"])


def _is_part(path: str, whole: str) -> bool:
    return not whole or path == whole or path.startswith((f"{whole}.", f"{whole}["))


def _placed(count: int, found: Sequence[tuple[NDArray[np.intp], Array]]) -> Array:
    """Put values at their indices; missing ones are NaN, or an empty string."""
    is_text = found[0][1].dtype.kind == "O"
    is_whole = sum(len(places) for places, _ in found) == count
    kind = found[0][1].dtype.newbyteorder("=") if is_whole or is_text else np.dtype(float)
    whole = np.full((count, *found[0][1].shape[1:]), "" if is_text else 0, kind)
    if not is_whole and not is_text:
        whole[...] = np.nan
    for places, values in found:
        whole[places] = values
    return whole
