"""Export a recording to Parquet or CSV, one file per topic, in parts of limited size.

Columns have the same names as in `obelisk_recordings`. In CSV each array element has its own
column, named after its joint.
"""

import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from obelisk_recordings.layout import Bytes, Column
from obelisk_recordings.run import RecordedRun
from obelisk_recordings.topic import MessageTable, RecordedTopic
from obelisk_spec.suggestions import list_names
from obk_cli.errors import CommandFailedError
from obk_cli.files import unwritable

__all__ = ["export_run"]

ExportFormat = Literal["parquet", "csv"]
_TIMES: Final = ("t", "published_ns", "received_ns")
"""Columns before the fields; `t` is in seconds since the activation of the stack."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedTopic:
    """A written file."""

    topic: str
    path: Path
    count: int
    """Number of messages."""


@dataclass(slots=True, kw_only=True)
class _Leaf:
    """A field in all messages of a topic."""

    path: str
    code: str
    """numpy type code of its numbers; empty for strings."""
    longest: int | None
    """Length of the longest array; None if it is not an array."""
    unit: str
    names: tuple[str, ...] = ()
    """Names of the joints, for an array with one number per joint."""

    @property
    def item(self) -> Any:
        return (
            pa.from_numpy_dtype(np.dtype(self.code).newbyteorder("=")) if self.code else pa.string()
        )

    def label(self, place: int) -> str:
        return (self.names[place] if place < len(self.names) else "") or str(place)


def export_run(
    run: RecordedRun, topics: Sequence[str], form: ExportFormat, folder: Path
) -> Iterator[ExportedTopic]:
    """Export the messages of some topics; topics without messages get no file.

    Args:
        run: the recording.
        topics: full names.
        form: format of the files.
        folder: output folder; created if necessary.

    Raises:
        CommandFailedError: no topic has messages, or a file cannot be written.
        RecordingError: the recording cannot be read.
    """
    leaves = _leaves(run, topics)
    if not leaves:
        raise _without_messages(run, topics)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:
            files: dict[str, _File] = {}
            for part in run.parts(leaves):
                if part.name not in files:
                    file = _File(run, part, form, folder, tuple(leaves[part.name].values()))
                    files[part.name] = file
                    stack.callback(file.discard)
                files[part.name].add(part)
            for topic, file in files.items():
                file.finish()
                yield ExportedTopic(topic=topic, path=file.path, count=file.count)
    except OSError as error:
        raise unwritable(folder, error) from error


def _without_messages(run: RecordedRun, topics: Sequence[str]) -> CommandFailedError:
    found = [topic.topic for topic in run.bag.topics if topic.count]
    what = f"messages of {list_names(topics)}" if topics and found else "messages"
    state = "" if run.bag.is_complete else "; its recorder did not close it"
    others = f"it has messages of {list_names(found)}" if found else None
    return CommandFailedError(f"{run.path} contains no {what}{state}", help=others)


def _leaves(run: RecordedRun, topics: Sequence[str]) -> dict[str, dict[str, _Leaf]]:
    """The fields of each topic, with the length of the longest array in all messages."""
    found: dict[str, dict[str, _Leaf]] = {}
    for part in run.parts(topics):
        leaves = found.setdefault(part.name, {})
        for layout, _, _ in part.tables:
            for path, column in layout.columns.items():
                leaf = leaves.get(path)
                if leaf is None:
                    leaf = leaves[path] = _Leaf(
                        path=path,
                        code=column.code,
                        longest=column.count,
                        unit=part.unit(path),
                        names=part.names(path),
                    )
                if leaf.longest is not None:
                    leaf.longest = max(leaf.longest, column.count or 0)
    return found


class _File:
    """One topic's file."""

    def __init__(
        self,
        run: RecordedRun,
        topic: RecordedTopic,
        form: ExportFormat,
        folder: Path,
        leaves: tuple[_Leaf, ...],
    ) -> None:
        name = topic.name.strip("/").replace("/", ".").lstrip(".") or "topic"
        self.path = folder / f"{name}.{form}"
        self.count = 0
        self._temporary = folder / f".{name}.{form}"
        self._leaves = leaves
        self._is_csv = form == "csv"
        schema = self._schema(run, topic)
        self._schema_of_all = schema
        self._writer: Any
        if self._is_csv:
            self._writer = pyarrow.csv.CSVWriter(str(self._temporary), schema)
        else:
            self._writer = pyarrow.parquet.ParquetWriter(
                str(self._temporary), schema, compression="zstd", use_dictionary=_texts_of(leaves)
            )

    def _schema(self, run: RecordedRun, topic: RecordedTopic) -> Any:
        fields = [
            pa.field("t", pa.float64(), metadata={"unit": "s"}),
            pa.field("published_ns", pa.int64(), metadata={"unit": "ns"}),
            pa.field("received_ns", pa.int64(), metadata={"unit": "ns"}),
        ]
        for leaf in self._leaves:
            metadata = {"unit": leaf.unit} if leaf.unit else {}
            if self._is_csv and leaf.longest is not None:
                fields += [
                    pa.field(f"{leaf.path}[{leaf.label(place)}]", leaf.item)
                    for place in range(leaf.longest)
                ]
                continue
            if leaf.names:
                metadata["names"] = json.dumps(leaf.names)
            kind = leaf.item if leaf.longest is None else pa.list_(leaf.item)
            fields.append(pa.field(_free(leaf.path), kind, metadata=metadata))
        about = {"topic": topic.name, "msg_type": topic.msg_type, "recording": run.name}
        return pa.schema(fields, metadata={"obelisk": json.dumps(about)})

    def add(self, part: RecordedTopic) -> None:
        """Write a part of the messages."""
        tables, places = [], []
        for table in part.tables:
            places.append(table[1])
            arrays = [*_times(part, table), *self._fields(table)]
            tables.append(pa.Table.from_arrays(arrays, schema=self._schema_of_all))
        whole = pa.concat_tables(tables)
        if len(tables) > 1:
            whole = whole.take(pa.array(np.argsort(np.concatenate(places), kind="stable")))
        self._writer.write_table(whole)
        self.count += len(part)

    def _fields(self, table: MessageTable) -> Iterator[Any]:
        layout, _, rows = table
        for leaf in self._leaves:
            column = layout.columns.get(leaf.path)
            if leaf.longest is None:
                yield _values(column.read(rows)) if column else pa.nulls(len(rows), leaf.item)
            elif self._is_csv:
                yield from _cells(leaf, column, rows)
            elif column is None:
                yield pa.nulls(len(rows), pa.list_(leaf.item))
            else:
                yield _lists(column, rows)

    def finish(self) -> None:
        """Move the file to its final path."""
        self._writer.close()
        self._temporary.replace(self.path)

    def discard(self) -> None:
        """Remove an unfinished file."""
        self._writer.close()
        self._temporary.unlink(missing_ok=True)


def _texts_of(leaves: tuple[_Leaf, ...]) -> list[str]:
    """The string columns, whose values repeat; for numbers, a dictionary would only take time."""
    return [
        _free(leaf.path) if leaf.longest is None else f"{leaf.path}.list.element"
        for leaf in leaves
        if not leaf.code
    ]


def _free(path: str) -> str:
    """A field's name that differs from the columns before the fields."""
    return f"{path}_" if path in _TIMES else path


def _times(part: RecordedTopic, table: MessageTable) -> tuple[Any, Any, Any]:
    places = table[1]
    messages = part.messages
    times = part.t, messages.published_ns, messages.received_ns
    return tuple(pa.array(one[places]) for one in times)


def _values(values: NDArray[Any]) -> Any:
    """An Arrow array of values of any type, shape `(n,)`."""
    if values.dtype != np.dtype(object):
        return pa.array(np.ascontiguousarray(values, values.dtype.newbyteorder("=")))
    return _texts(values[:, None])


def _texts(texts: NDArray[Any]) -> Any:
    """An Arrow array of strings, shape `(n, k)`, row by row."""
    if len(texts) and (texts == texts[0]).all():  # as joint names are
        every = np.tile(np.arange(texts.shape[1]), len(texts))
        return pa.array(texts[0].tolist(), pa.string()).take(pa.array(every))
    return pa.array(texts.ravel().tolist(), pa.string())


def _lists(column: Column, rows: Bytes) -> Any:
    values = column.read(rows)
    items = _values(values.reshape(-1)) if column.code else _texts(values)
    length = values.shape[1]
    offsets = np.arange(len(rows) + 1, dtype=np.int32) * np.int32(length)
    return pa.ListArray.from_arrays(pa.array(offsets), items)


def _cells(leaf: _Leaf, column: Column | None, rows: Bytes) -> Iterator[Any]:
    values = column.read(rows) if column else np.empty((len(rows), 0))
    for place in range(leaf.longest or 0):
        if place < values.shape[1]:
            yield _values(values[:, place])
        else:
            yield pa.nulls(len(rows), leaf.item)
