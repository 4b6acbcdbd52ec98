"""Reads recordings: MCAP files, those of a killed recorder too, up to where they break off.

Messages are decoded by the definitions in the file; neither ROS nor the types need be installed.
"""

import struct
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Final

from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Chunk, Header, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.summary import Summary

from obk_cli.adapters.bag_chunks import messages_in_order, records_of
from obk_cli.adapters.bag_messages import MessageDecoders
from obk_cli.errors import CommandFailedError
from obk_cli.files import explain_os_error
from obk_cli.recording.bag import Bag, BagTopic
from obk_cli.recording.tally import DROPS
from obk_cli.report.escapes import plain

__all__ = ["BagMessage", "messages_of", "read_bag"]

_BREAKS = (EndOfFile, struct.error)
"""What the library raises where a file ends in the middle of a record."""
LONGEST_FAULT: Final = 200
"""Of the library's words [characters]."""
LONGEST_RECORD: Final = 1 << 28
"""What a record may claim to have: far more than any chunk or attachment of a recorder [bytes]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BagMessage:
    """One message of a recording."""

    topic: str
    received_ns: int
    """When the recorder got it [ns since 1970]."""
    published_ns: int
    """When it was published [ns since 1970]; that of receipt where the recorder did not know."""
    value: Any
    """Its fields as attributes."""


def read_bag(path: Path) -> Bag:
    """What a recording holds.

    Raises:
        CommandFailedError: it cannot be read, or is none.
    """
    with _faults_told(path), path.open("rb") as file:
        return _indexed(path, file) or _scanned(path, file)


def messages_of(path: Path, topics: Collection[str]) -> Iterator[BagMessage]:
    """The messages of some topics, in the order in which they came where the file has an index.

    Raises:
        CommandFailedError: the file cannot be read, or a message of it.
    """
    decoders = MessageDecoders()
    with _faults_told(path), path.open("rb") as file:
        for schema, channel, message in _messages(file, topics):
            decode = decoders.decoder_of(channel, schema)
            if decode is None:
                raise CommandFailedError(
                    f"{path}: {plain(channel.topic)} cannot be decoded: it is not in the form of "
                    "ROS 2 messages with their definition"
                )
            value = decode(message.data)
            yield BagMessage(
                topic=channel.topic,
                received_ns=message.log_time,
                published_ns=message.publish_time or message.log_time,
                value=value,
            )


def _messages(
    file: IO[bytes], topics: Collection[str]
) -> Iterator[tuple[Schema | None, Channel, Message]]:
    summary = _summary(file)
    if summary is not None and summary.chunk_indexes:
        yield from messages_in_order(file, summary, topics)
        return
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    for record in _records(file):
        match record:
            case Schema():
                schemas[record.id] = record
            case Channel():
                channels[record.id] = record
            case Message() if channels[record.channel_id].topic in topics:
                channel = channels[record.channel_id]
                yield schemas.get(channel.schema_id), channel, record


def _summary(file: IO[bytes]) -> Summary | None:
    """What stands behind a recording that was ended; leaves the file at its beginning."""
    try:
        summary = _seeking(file).get_summary()
    except Exception:  # the end of the file is no footer, whatever the library makes of it
        summary = None
    file.seek(0)
    return None if summary is None or summary.statistics is None else summary


def _records(file: IO[bytes]) -> Iterator[object]:
    """Every record up to where the file breaks off."""
    reader = StreamReader(file, emit_chunks=True, record_size_limit=LONGEST_RECORD)
    try:
        for record in reader.records:
            if isinstance(record, Chunk):
                yield from records_of(record)
            else:
                yield record
    except _BREAKS:
        return


@dataclass(slots=True, kw_only=True)
class _Found:
    """What was seen of a file so far."""

    header: Header | None = None
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    times_ns: tuple[int, int] | None = None
    metadata: dict[str, Mapping[str, str]] = field(default_factory=dict)
    attachments: dict[str, int] = field(default_factory=dict)


def _indexed(path: Path, file: IO[bytes]) -> Bag | None:
    """Read what the index at the end tells; None where there is none."""
    summary = _summary(file)
    if summary is None or summary.statistics is None:
        return None
    reader, told = _seeking(file), summary.statistics
    found = _Found(
        header=reader.get_header(),
        schemas=summary.schemas,
        channels=summary.channels,
        counts=Counter(told.channel_message_counts),
        times_ns=(told.message_start_time, told.message_end_time) if told.message_count else None,
        metadata={record.name: record.metadata for record in reader.iter_metadata()},
        attachments={index.name: index.data_size for index in summary.attachment_indexes},
    )
    return _bag(path, file, found, is_complete=True)


def _scanned(path: Path, file: IO[bytes]) -> Bag:
    """Read from the beginning to where the file breaks off."""
    found = _Found()
    for record in _records(file):
        match record:
            case Header():
                found.header = record
            case Schema():
                found.schemas[record.id] = record
            case Channel():
                found.channels[record.id] = record
            case Message():
                found.counts[record.channel_id] += 1
                first, last = found.times_ns or (record.log_time, record.log_time)
                found.times_ns = min(first, record.log_time), max(last, record.log_time)
            case Metadata():
                found.metadata[record.name] = record.metadata
            case Attachment():
                found.attachments[record.name] = len(record.data)
    return _bag(path, file, found, is_complete=False)


def _bag(path: Path, file: IO[bytes], found: _Found, *, is_complete: bool) -> Bag:
    drops = found.metadata.pop(DROPS, {})
    topics = (
        BagTopic(
            topic=channel.topic,
            msg_type=found.schemas[channel.schema_id].name if channel.schema_id else "",
            count=found.counts[channel.id],
            dropped=int(drops[channel.topic]) if channel.topic in drops else None,
            type_hash=channel.metadata.get("topic_type_hash", ""),
        )
        for channel in found.channels.values()
    )
    start_ns, end_ns = found.times_ns or (None, None)
    return Bag(
        path=str(path),
        size_bytes=file.seek(0, 2),
        profile=found.header.profile if found.header else "",
        library=found.header.library if found.header else "",
        is_complete=is_complete,
        start_ns=start_ns,
        end_ns=end_ns,
        topics=tuple(sorted(topics, key=lambda topic: topic.topic)),
        metadata=found.metadata,
        attachments=found.attachments,
    )


def _seeking(file: IO[bytes]) -> SeekingReader:
    return SeekingReader(file, record_size_limit=LONGEST_RECORD)


@contextmanager
def _faults_told(path: Path) -> Iterator[None]:
    """While entered, what comes out of the libraries is told of the file.

    They look at no field before they use it: a damaged file makes them raise anything.

    Raises:
        CommandFailedError: the file cannot be read.
    """
    try:
        yield
    except CommandFailedError:
        raise
    except OSError as error:
        raise CommandFailedError(f"{path}: {explain_os_error(error)}") from error
    except InvalidMagic as error:
        raise CommandFailedError(f"{path} is no MCAP file") from error
    except Exception as error:
        fault = plain(f"{type(error).__name__}: {error}")[:LONGEST_FAULT]
        raise CommandFailedError(f"{path} cannot be read: it is damaged ({fault})") from error
