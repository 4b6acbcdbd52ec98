"""Read the messages of a recording one by one, decoded by the definitions in the file.

The file need not be sound. `mcap_ros2` takes unbounded time for comments and constants and returns
short values where bytes are missing, so it gets definitions with fields only, and bytes that raise
when a slice is incomplete.
"""

import re
from collections.abc import Callable, Collection, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import IO, Any, Final, SupportsIndex

from mcap.records import Channel, Message, Schema
from mcap_ros2.decoder import DecoderFactory

from obelisk_recordings.errors import RecordingError
from obelisk_recordings.summary import file_summary, recording_errors, records_of, seeking_reader

__all__ = ["BagMessage", "messages_of"]

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


def messages_of(path: Path, topics: Collection[str]) -> Iterator[BagMessage]:
    """The messages of some topics, in order of receipt if the file has an index.

    Raises:
        RecordingError: the file or a message in it cannot be read.
    """
    decoders = _Decoders()
    with recording_errors(path), path.open("rb") as file:
        for schema, channel, message in _messages(file, topics):
            decode = decoders.decoder_of(channel, schema)
            if decode is None:
                raise RecordingError(
                    f"{path}: {channel.topic} cannot be decoded: it is not in the form of "
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
    summary = file_summary(file)
    if summary is not None and summary.chunk_indexes:
        yield from seeking_reader(file).iter_messages(topics)
        return
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    for record in records_of(file):
        match record:
            case Schema():
                schemas[record.id] = record
            case Channel():
                channels[record.id] = record
            case Message() if channels[record.channel_id].topic in topics:
                channel = channels[record.channel_id]
                yield schemas.get(channel.schema_id), channel, record
