"""Read the messages of an MCAP file by topic, as tables of bytes, many at once.

A truncated file, such as that of a killed recorder, is read up to its end.
Source: MCAP specification, records Message (op 5) and Chunk (op 6).
"""

import struct
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import IO, Final

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from numpy.typing import NDArray

from obelisk_recordings.bag import RecordingError
from obelisk_recordings.layout import Bytes
from obelisk_recordings.summary import LONGEST_RECORD, recording_errors

__all__ = [
    "RecordedMessage",
    "TopicMessages",
    "joined",
    "messages_in_order",
    "messages_in_parts",
]

_RECORD: Final = struct.Struct("<BQ")
_RECORD_TYPE: Final = np.dtype([("kind", "u1"), ("length", "<u8")])
_SCHEMA, _CHANNEL, _MESSAGE = 3, 4, 5
_INDEX_HEAD: Final = 6
"""Bytes before the entries of a message index: channel, length in bytes."""
_HEAD: Final = np.dtype(
    {
        "names": ["channel", "sequence", "received", "published"],
        "formats": ["<u2", "<u4", "<i8", "<i8"],
        "offsets": [0, 2, 6, 14],
        "itemsize": 22,
    }
)
"""Header of a message's data: channel, sequence number, two times."""
_MOST_LOOSE: Final = 10_000
"""Number of messages outside chunks that are read at once."""
PART_BYTES: Final = 16 << 20
"""Default size of a part of one topic [bytes]."""
Times = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicMessages:
    """Serialized messages of one topic, in the order of the file."""

    topic: str
    msg_type: str
    definition: str
    """Text of the message definition; empty if the file has none that can be read."""
    received_ns: Times
    """When the recorder received them [ns since 1970], shape `(n,)`."""
    published_ns: Times
    """When they were published [ns since 1970], shape `(n,)`; the time of receipt if unknown."""
    sequence: NDArray[np.uint32]
    """The recorder's sequence numbers, shape `(n,)`; in lockstep, in the order of publication."""
    tables: tuple[tuple[NDArray[np.intp], Bytes], ...]
    """For each length in bytes: indices among the n messages, and their bytes, one per row."""

    def __len__(self) -> int:
        return len(self.received_ns)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedMessage:
    """One serialized message."""

    topic: str
    received_ns: int
    """When the recorder received it [ns since 1970]."""
    published_ns: int
    """When it was published [ns since 1970]; the time of receipt if unknown."""
    sequence: int
    """The recorder's sequence number; in lockstep, in the order of publication."""
    data: bytes


def joined(parts: list[TopicMessages]) -> TopicMessages:
    """Join at least one part of a topic, in the order of receipt."""
    tables: dict[int, list[tuple[NDArray[np.intp], Bytes]]] = defaultdict(list)
    start = 0
    for part in parts:
        for places, rows in part.tables:
            tables[rows.shape[1]].append((places + start, rows))
        start += len(part)
    received = np.concatenate([part.received_ns for part in parts])
    published = np.concatenate([part.published_ns for part in parts])
    sequence = np.concatenate([part.sequence for part in parts])
    moved: NDArray[np.intp] | None = None
    if (received[1:] < received[:-1]).any():
        order = np.argsort(received.view(np.uint64), kind="stable")
        received, published, sequence = received[order], published[order], sequence[order]
        moved = np.empty_like(order)
        moved[order] = np.arange(len(order))
    whole = []
    for found in tables.values():
        places = np.concatenate([places for places, _ in found])
        rows = found[0][1] if len(found) == 1 else np.concatenate([rows for _, rows in found])
        if moved is not None:
            order = np.argsort(moved[places], kind="stable")
            places, rows = moved[places][order], rows[order]
        whole.append((places, rows))
    return TopicMessages(
        topic=parts[0].topic,
        msg_type=parts[0].msg_type,
        definition=parts[0].definition,
        received_ns=received,
        published_ns=published,
        sequence=sequence,
        tables=tuple(whole),
    )


@dataclass(slots=True)
class _Schemas:
    """Schemas and channels so far, and the wanted topics."""

    topics: Collection[str]
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)

    def add(self, record: object) -> None:
        match record:
            case Schema():
                self.schemas.setdefault(record.id, record)
            case Channel():
                self.channels.setdefault(record.id, record)

    def wanted(self) -> Mapping[int, Channel]:
        return {id: one for id, one in self.channels.items() if one.topic in self.topics}

    def empty(self, channel: Channel) -> tuple[str, str]:
        """Return type and definition of a channel's messages."""
        schema = self.schemas.get(channel.schema_id)
        is_cdr = channel.message_encoding == "cdr"
        if schema is None or schema.encoding != "ros2msg" or not is_cdr:
            return schema.name if schema else "", ""
        return schema.name, schema.data.decode(errors="replace")


def messages_in_parts(
    path: Path, topics: Collection[str], *, part_bytes: int | None = None
) -> Iterator[TopicMessages]:
    """Read the messages of some topics, in parts of limited size with one topic each.

    Args:
        path: path of the file.
        topics: full names.
        part_bytes: approximate size of the parts of one topic [bytes]; None for `PART_BYTES`.

    Raises:
        RecordingError: the file cannot be read.
    """
    limit = PART_BYTES if part_bytes is None else part_bytes
    with recording_errors(path), path.open("rb") as file:
        schemas = _Schemas(topics)
        waiting: dict[tuple[str, str], list[TopicMessages]] = defaultdict(list)
        sizes: dict[tuple[str, str], int] = defaultdict(int)
        for part in chain.from_iterable(_chunks(file, schemas)):
            key = part.topic, part.definition
            waiting[key].append(part)
            sizes[key] += sum(rows.nbytes for _, rows in part.tables)
            if sizes[key] >= limit:
                sizes[key] = 0
                yield joined(waiting.pop(key))
        for parts in waiting.values():
            yield joined(parts)


def messages_in_order(path: Path, topics: Collection[str]) -> Iterator[RecordedMessage]:
    """Read the messages of some topics one by one, in the order of receipt within each chunk.

    Recorders write chunks one after another; chunks overlap only in files from elsewhere.

    Args:
        path: path of the file.
        topics: full names.

    Raises:
        RecordingError: the file cannot be read.
    """
    with recording_errors(path), path.open("rb") as file:
        for parts in _chunks(file, _Schemas(topics)):
            yield from _in_order(parts)


def _in_order(parts: Sequence[TopicMessages]) -> Iterator[RecordedMessage]:
    found = []
    for part in parts:
        for places, rows in part.tables:
            for place, row in zip(places, rows, strict=True):
                one = RecordedMessage(
                    topic=part.topic,
                    received_ns=int(part.received_ns[place]),
                    published_ns=int(part.published_ns[place]),
                    sequence=int(part.sequence[place]),
                    data=row.tobytes(),
                )
                found.append(one)
    yield from sorted(found, key=lambda one: (one.received_ns, one.sequence))


@dataclass(slots=True)
class _RawIndex(McapRecord):
    """The message index of one channel in the chunk before it, not decoded."""

    data: bytes

    def entries(self) -> NDArray[np.uint64]:
        """Time of receipt and offset of each message, shape `(n, 2)`."""
        return np.frombuffer(self.data, "<u8", offset=_INDEX_HEAD).reshape(-1, 2)


class _ChunkReader(StreamReader):
    """Does not decode message indexes, which would take half of the time."""

    def _read_record(self, opcode: int, length: int) -> McapRecord | None:
        if opcode == Opcode.MESSAGE_INDEX:
            return _RawIndex(self._stream.read(length))
        return super()._read_record(opcode, length)


def _chunks(file: IO[bytes], schemas: _Schemas) -> Iterator[Sequence[TopicMessages]]:
    """Yield the wanted messages by topic, chunk by chunk."""
    loose: list[Message] = []
    indexes: list[_RawIndex] = []
    chunk: Chunk | None = None
    reader = _ChunkReader(file, emit_chunks=True, record_size_limit=LONGEST_RECORD)
    with suppress(EndOfFile, struct.error):  # the file is truncated
        for record in reader.records:
            if isinstance(record, _RawIndex):
                indexes.append(record)
                continue
            if chunk is not None:
                yield tuple(_chunk(_content(chunk), schemas, indexes))
                chunk, indexes = None, []
            schemas.add(record)
            if isinstance(record, Chunk):
                chunk = record
            elif isinstance(record, Message):
                loose.append(record)
                if len(loose) == _MOST_LOOSE:
                    yield tuple(_loose(loose, schemas))
                    loose = []
    if chunk is not None:
        yield tuple(_chunk(_content(chunk), schemas, indexes))
    yield tuple(_loose(loose, schemas))


def _content(chunk: Chunk) -> bytes:
    stream, length = get_chunk_data_stream(chunk)
    return stream.read(length)


def _loose(messages: list[Message], schemas: _Schemas) -> Iterator[TopicMessages]:
    """Yield messages that are in no chunk, by topic."""
    data = bytearray()
    for one in messages:
        data += _RECORD.pack(_MESSAGE, _HEAD.itemsize + len(one.data))
        data += struct.pack("<HIQQ", one.channel_id, one.sequence, one.log_time, one.publish_time)
        data += one.data
    yield from _chunk(bytes(data), schemas)


def _chunk(
    data: bytes, schemas: _Schemas, indexes: Sequence[_RawIndex] = ()
) -> Iterator[TopicMessages]:
    """Yield the wanted messages of a chunk, by topic."""
    starts, ends = _indexed_messages(data, indexes) or _messages_of_chunk(data, schemas)
    if not len(starts):
        return
    every = np.frombuffer(data, np.uint8)
    heads = _rows(every, starts, _HEAD.itemsize).view(_HEAD)[:, 0]
    for id, channel in schemas.wanted().items():
        is_own = heads["channel"] == id
        if not is_own.any():
            continue
        own, offsets = heads[is_own], starts[is_own] + _HEAD.itemsize
        sizes = ends[is_own] - offsets
        tables = []
        for size in np.unique(sizes) if (sizes != sizes[0]).any() else sizes[:1]:
            places = np.flatnonzero(sizes == size)
            tables.append((places, _rows(every, offsets[places], int(size))))
        msg_type, definition = schemas.empty(channel)
        received = np.ascontiguousarray(own["received"])
        yield TopicMessages(
            topic=channel.topic,
            msg_type=msg_type,
            definition=definition,
            received_ns=received,
            published_ns=np.where(own["published"] == 0, received, own["published"]),
            sequence=np.ascontiguousarray(own["sequence"]),
            tables=tuple(tables),
        )


def _indexed_messages(data: bytes, indexes: Sequence[_RawIndex]) -> tuple[Times, Times] | None:
    """Return starts and ends of a chunk's messages from its indexes; faster than walking it.

    None if the chunk contains anything that the indexes do not list, such as channels.
    """
    if not indexes or any((len(one.data) - _INDEX_HEAD) % 16 for one in indexes):
        return None
    offsets = np.sort(np.concatenate([one.entries()[:, 1] for one in indexes]))
    last = len(data) - _RECORD.size - _HEAD.itemsize
    if not len(offsets) or offsets[0] != 0 or offsets[-1] > last:
        return None
    records = offsets.view(np.int64)
    heads = _rows(np.frombuffer(data, np.uint8), records, _RECORD.size).view(_RECORD_TYPE)[:, 0]
    starts = records + _RECORD.size
    ends = starts + heads["length"].view(np.int64)
    is_whole = (heads["kind"] == _MESSAGE).all() and (heads["length"] >= _HEAD.itemsize).all()
    is_whole = is_whole and (ends[:-1] == records[1:]).all() and ends[-1] == len(data)
    return (starts, ends) if is_whole else None


def _messages_of_chunk(data: bytes, schemas: _Schemas) -> tuple[Times, Times]:
    """Return starts and ends of a chunk's messages, and record its schemas and channels."""
    starts, ends, offset, last = list[int](), list[int](), 0, len(data) - _RECORD.size
    unpack, head = _RECORD.unpack_from, _RECORD.size
    while offset <= last:
        kind, length = unpack(data, offset)
        offset += head
        end = offset + length
        if end > len(data):
            raise RecordingError("a chunk is damaged: a record in it is truncated")
        if kind == _MESSAGE:
            if length < _HEAD.itemsize:
                raise RecordingError("a chunk is damaged: a message in it has no times")
            starts.append(offset)
            ends.append(end)
        elif kind in (_SCHEMA, _CHANNEL):
            stream = ReadDataStream(BytesIO(data[offset:end]))
            schemas.add(Schema.read(stream) if kind == _SCHEMA else Channel.read(stream))
        offset = end
    return np.array(starts, np.int64), np.array(ends, np.int64)


def _rows(data: Bytes, starts: Times, size: int) -> Bytes:
    """Return parts of the same size as a table, shape `(n, size)`."""
    if size == 0:
        return np.empty((len(starts), 0), np.uint8)
    # Like `sliding_window_view`, which takes longer than the copy.
    windows = (len(data) - size + 1, size)
    return np.ndarray(windows, np.uint8, data, strides=(1, 1))[starts]
