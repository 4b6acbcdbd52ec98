"""Chunks of recordings, opened within bounds: what a file claims of them need not be true.

In: chunks, compressed or not. Out: the records inside, one after another. A few kilobytes can claim
to hold gigabytes, or really hold them; neither is more memory than `LARGEST_CHUNK`, and messages
that wait for their turn are no more than `MOST_WAITING`.
"""

import heapq
from collections.abc import Collection, Iterator
from io import BytesIO
from typing import IO, Final

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.records import Channel, Chunk, ChunkIndex, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.summary import Summary

__all__ = ["LARGEST_CHUNK", "MOST_WAITING", "ChunkError", "messages_in_order", "records_of"]

LARGEST_CHUNK: Final = 1 << 28
"""What a chunk may hold: far more than any recorder puts into one [bytes]."""
MOST_WAITING: Final = 1 << 29
"""Of messages whose chunks overlap, and which wait for earlier ones [bytes]."""
_MESSAGE_BYTES: Final = 400
"""What an empty message takes in memory [bytes]."""
_HEAD: Final = 1 + 8
"""Of a record: its kind and length [bytes]."""


class ChunkError(ValueError):
    """A chunk that is not what it claims to be, or more than anybody can hold."""


def records_of(chunk: Chunk) -> Iterator[object]:
    """The records in a chunk.

    Raises:
        ChunkError: it cannot be opened, or holds more or less than it claims.
    """
    data = _opened(chunk)
    buffer = BytesIO(data)
    inside = StreamReader(buffer, skip_magic=True, emit_chunks=True, record_size_limit=len(data))
    records = iter(inside.records)
    while buffer.tell() < len(data):
        yield next(records)


def messages_in_order(
    file: IO[bytes], summary: Summary, topics: Collection[str]
) -> Iterator[tuple[Schema | None, Channel, Message]]:
    """The messages of some topics, in the order of their receipt, by the index of a file.

    Raises:
        ChunkError: as for `records_of`, or too many messages wait for earlier ones.
    """
    wanted = {number for number, channel in summary.channels.items() if channel.topic in topics}
    waiting: list[tuple[int, int, int, Message]] = []
    waiting_bytes = 0

    def next_one() -> tuple[Schema | None, Channel, Message]:
        nonlocal waiting_bytes
        message = heapq.heappop(waiting)[3]
        waiting_bytes -= len(message.data) + _MESSAGE_BYTES
        channel = summary.channels[message.channel_id]
        # 0 stands for none.
        schema = summary.schemas[channel.schema_id] if channel.schema_id else None
        return schema, channel, message

    for index in sorted(summary.chunk_indexes, key=lambda index: index.message_start_time):
        if index.message_index_offsets and not wanted & index.message_index_offsets.keys():
            continue
        while waiting and waiting[0][0] < index.message_start_time:
            yield next_one()
        for number, record in enumerate(records_of(_chunk_at(file, index))):
            if isinstance(record, Message) and record.channel_id in wanted:
                place = (record.log_time, index.chunk_start_offset, number)
                heapq.heappush(waiting, (*place, record))
                waiting_bytes += len(record.data) + _MESSAGE_BYTES
                if waiting_bytes > MOST_WAITING:
                    raise ChunkError(f"messages out of order take more than {MOST_WAITING} bytes")
    while waiting:
        yield next_one()


def _chunk_at(file: IO[bytes], index: ChunkIndex) -> Chunk:
    if index.chunk_length > LARGEST_CHUNK:
        raise ChunkError(f"a chunk claims to have {index.chunk_length} bytes in the file")
    file.seek(index.chunk_start_offset)
    record = BytesIO(file.read(index.chunk_length))
    record.seek(_HEAD)
    chunk: Chunk = Chunk.read(ReadDataStream(record))
    return chunk


def _opened(chunk: Chunk) -> bytes:
    size = chunk.uncompressed_size
    if size > LARGEST_CHUNK:
        raise ChunkError(f"a chunk claims to hold {size} bytes, more than {LARGEST_CHUNK}")
    if chunk.compression == "zstd":
        data = _first_bytes(zstandard.ZstdDecompressor().stream_reader(chunk.data), size + 1)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    elif not chunk.compression:
        data = chunk.data
    else:
        raise ChunkError(f"a chunk is compressed by `{chunk.compression}`, not by zstd or lz4")
    if len(data) != size:
        more = "more" if len(data) > size else f"{len(data)}"
        raise ChunkError(f"a chunk claims to hold {size} bytes and holds {more}")
    return data


def _first_bytes(stream: IO[bytes], most: int) -> bytes:
    """As many as there are, up to `most`: a buffer grows with what really comes."""
    parts = []
    while most > 0 and (part := stream.read(min(most, 1 << 20))):
        parts.append(part)
        most -= len(part)
    return b"".join(parts)
