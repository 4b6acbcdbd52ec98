"""Read recordings: MCAP files, including those of a killed recorder, up to where they break off.

Messages are decoded by the definitions in the file; neither ROS nor the types need be installed.
The file need not be sound. `mcap_ros2` takes unbounded time for comments and constants and returns
short values where bytes are missing, so it gets definitions with fields only, and bytes that raise
when a slice is incomplete.
"""

import re
import struct
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass, field, replace
from io import StringIO
from pathlib import Path
from typing import IO, Any, Final, SupportsIndex

from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.summary import Summary
from mcap_ros2.decoder import DecoderFactory

from obk_cli.errors import CommandFailedError
from obk_cli.files import explain_os_error
from obk_cli.record.recording import DROPS, Bag, BagTopic
from obk_cli.terminal import plain

__all__ = ["BagMessage", "messages_of", "read_bag"]

_FIELD: Final = re.compile(r"\s*(?P<type>\S+)\s+(?P<name>\w+)\s*(?P<equals>=)?")
_BEGINS_DEFINITION: Final = ("===", "MSG:")


class _Decoders:
    """The decoders of one file, each created once."""

    def __init__(self) -> None:
        self._library = DecoderFactory()
        self._schemas: dict[int, Schema] = {}

    def decoder_of(self, channel: Channel, schema: Schema | None) -> Callable[[bytes], Any] | None:
        """The decoder of a channel's messages; None: they are not ROS 2 messages in CDR.

        Raises:
            Exception: of any kind, as does the decoder: the definition or a message is damaged.
        """
        if schema is not None:
            if schema.id not in self._schemas:
                self._schemas[schema.id] = replace(schema, data=_fields_only(schema.data))
            schema = self._schemas[schema.id]
        # The library prints what it cannot parse, with any control characters that are in it.
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            decode = self._library.decoder_for(channel.message_encoding, schema)
        return None if decode is None else lambda data: decode(_Uncut(data))


class _Uncut(bytes):
    """Bytes whose slices raise an error where they would be cut short."""

    def __getitem__(self, place: SupportsIndex | slice) -> Any:
        if isinstance(place, slice) and place.stop is not None and place.stop > len(self):
            raise EOFError(f"{place.stop} bytes were expected, there are {len(self)}")
        return super().__getitem__(place)


def _fields_only(definition: bytes) -> bytes:
    """A definition and those that it refers to, without comments, constants and defaults."""
    return "\n".join(map(_field_only, definition.decode().splitlines())).encode()


def _field_only(line: str) -> str:
    code = line.partition("#")[0].rstrip()
    field = None if code.startswith(_BEGINS_DEFINITION) else _FIELD.match(code)
    if field is None:
        return code
    return "" if field["equals"] else f"{field['type']} {field['name']}"


_BREAKS = (EndOfFile, struct.error)
"""Raised by the library when a file ends in the middle of a record."""
LONGEST_FAULT: Final = 200
"""Limit for the text of an error of the library [characters]."""
LONGEST_RECORD: Final = 1 << 28
"""Limit for a record in the file: far above any chunk or attachment of a recorder [bytes]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BagMessage:
    """One message of a recording."""

    topic: str
    received_ns: int
    """When the recorder received it [ns since 1970]."""
    published_ns: int
    """When it was published [ns since 1970]; the time of receipt if unknown."""
    value: Any
    """Its fields as attributes."""


def read_bag(path: Path) -> Bag:
    """Read the summary of a recording.

    Raises:
        CommandFailedError: it cannot be read, or is not an MCAP file.
    """
    with _errors_of(path), path.open("rb") as file:
        return _indexed(path, file) or _scanned(path, file)


def messages_of(path: Path, topics: Collection[str]) -> Iterator[BagMessage]:
    """The messages of some topics, in order of receipt if the file has an index.

    Raises:
        CommandFailedError: the file or a message in it cannot be read.
    """
    decoders = _Decoders()
    with _errors_of(path), path.open("rb") as file:
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
        yield from _seeking(file).iter_messages(topics)
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
    """The summary at the end of a closed recording; leaves the file at its start."""
    try:
        summary = _seeking(file).get_summary()
    except Exception:  # the file does not end in a footer: the library may raise anything
        summary = None
    file.seek(0)
    return None if summary is None or summary.statistics is None else summary


def _records(file: IO[bytes]) -> Iterator[object]:
    """Every record, in and outside of chunks, up to where the file breaks off."""
    with suppress(*_BREAKS):
        yield from StreamReader(file, record_size_limit=LONGEST_RECORD).records


@dataclass(slots=True, kw_only=True)
class _Found:
    """The content of a file so far."""

    header: Header | None = None
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    times_ns: tuple[int, int] | None = None
    metadata: dict[str, Mapping[str, str]] = field(default_factory=dict)
    attachments: dict[str, int] = field(default_factory=dict)


def _indexed(path: Path, file: IO[bytes]) -> Bag | None:
    """The recording by the summary at its end; None if it has none."""
    summary = _summary(file)
    if summary is None or summary.statistics is None:
        return None
    reader, statistics = _seeking(file), summary.statistics
    found = _Found(
        header=reader.get_header(),
        schemas=summary.schemas,
        channels=summary.channels,
        counts=Counter(statistics.channel_message_counts),
        times_ns=(statistics.message_start_time, statistics.message_end_time)
        if statistics.message_count
        else None,
        metadata={record.name: record.metadata for record in reader.iter_metadata()},
        attachments={index.name: index.data_size for index in summary.attachment_indexes},
    )
    return _bag(path, file, found, is_complete=True)


def _scanned(path: Path, file: IO[bytes]) -> Bag:
    """The recording by its records, up to where the file breaks off."""
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
def _errors_of(path: Path) -> Iterator[None]:
    """Report errors of the libraries as errors of the file.

    They use fields unchecked: a damaged file makes them raise anything.

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
