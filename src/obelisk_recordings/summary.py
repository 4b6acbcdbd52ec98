"""Summarize a recording: topics, counts, times and metadata, without decoding any message.

A truncated file, such as that of a killed recorder, is read up to its end.
"""

import os
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Final

from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.summary import Summary

from obelisk_recordings.bag import DROPS, Bag, BagTopic, RecordingError

__all__ = ["LONGEST_RECORD", "read_attachments", "read_bag", "recording_errors"]

_BREAKS = (EndOfFile, struct.error)
"""Raised by the library if a file ends in the middle of a record."""
LONGEST_FAULT: Final = 200
"""Maximum length of a library's error text [characters]."""
_MAGIC: Final = b"\x89MCAP0\r\n"
"""The start of every MCAP file."""
LONGEST_RECORD: Final = 1 << 28
"""Maximum size of a record in the file, far above any chunk or attachment of a recorder [bytes]."""


def read_bag(path: Path) -> Bag:
    """Read the summary of a recording.

    Raises:
        RecordingError: it cannot be read or is not an MCAP file.
    """
    with recording_errors(path), path.open("rb") as file:
        if not _MAGIC.startswith(start := file.read(len(_MAGIC))):
            raise InvalidMagic(start)
        file.seek(0)
        return _indexed(path, file) or _scanned(path, file)


def read_attachments(path: Path) -> Mapping[str, str]:
    """Return the text files in a recording by name, such as `plan.json`.

    Raises:
        RecordingError: it cannot be read.
    """
    with recording_errors(path), path.open("rb") as file:
        found = (
            seeking_reader(file).iter_attachments()
            if file_summary(file) is not None
            else (one for one in records_of(file) if isinstance(one, Attachment))
        )
        return {one.name: one.data.decode(errors="replace") for one in found}


def records_of(file: IO[bytes]) -> Iterator[object]:
    """Yield every record, inside and outside chunks, up to the end of a truncated file."""
    with suppress(*_BREAKS):
        yield from StreamReader(file, record_size_limit=LONGEST_RECORD).records


def file_summary(file: IO[bytes]) -> Summary | None:
    """Return the summary at the end of a closed recording, and rewind the file."""
    try:
        summary = seeking_reader(file).get_summary()
    except Exception:  # the file does not end in a footer: the library may raise anything
        summary = None
    file.seek(0)
    return None if summary is None or summary.statistics is None else summary


@dataclass(slots=True, kw_only=True)
class _Found:
    """The contents of a file so far."""

    header: Header | None = None
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    times_ns: tuple[int, int] | None = None
    metadata: dict[str, Mapping[str, str]] = field(default_factory=dict)
    attachments: dict[str, int] = field(default_factory=dict)


def _indexed(path: Path, file: IO[bytes]) -> Bag | None:
    """Read the summary at the end of a recording; None if it has none."""
    summary = file_summary(file)
    if summary is None or summary.statistics is None:
        return None
    reader, statistics = seeking_reader(file), summary.statistics
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
    """Summarize a recording by reading all records, up to the end of a truncated file."""
    found = _Found()
    for record in records_of(file):
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
            lost=int(drops[channel.topic]) if channel.topic in drops else None,
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


def seeking_reader(file: IO[bytes]) -> SeekingReader:
    """Create the library's reader of a file, with a limit on the size of a record."""
    return SeekingReader(file, record_size_limit=LONGEST_RECORD)


@contextmanager
def recording_errors(path: Path) -> Iterator[None]:
    """Report errors of the libraries as errors of the file.

    The libraries do not validate fields, so a damaged file can cause any exception.

    Raises:
        RecordingError: the file cannot be read.
    """
    try:
        yield
    except RecordingError as error:
        raise RecordingError(f"{path}: {_plain(error.message)}", help=error.help) from error
    except FileNotFoundError as error:
        raise RecordingError(f"{path}: file not found") from error
    except OSError as error:
        raise RecordingError(f"{path}: {os.strerror(error.errno or 0).lower()}") from error
    except InvalidMagic as error:
        raise RecordingError(f"{path} is not an MCAP file") from error
    except Exception as error:
        fault = _plain(f"{type(error).__name__}: {error}")[:LONGEST_FAULT]
        raise RecordingError(f"{path} cannot be read: it is damaged ({fault})") from error


def _plain(text: str) -> str:
    """Remove characters that a terminal would interpret."""
    return "".join(letter for letter in text if letter.isprintable())
