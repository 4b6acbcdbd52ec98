"""Write a recording as an MCAP file like those of rosbag2, readable even if its writer is killed.

The file consists of whole chunks, at most `FLUSH_S` old if `flush` is called that often; only the
index at the end needs `close`.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import yaml
from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import Writer

from obk_cli.errors import CommandFailedError
from obk_cli.files import unwritable
from obk_cli.optional_deps import run_versions
from obk_cli.ros.raw_subscription import OfferedQos

__all__ = ["FLUSH_S", "BagWriter", "offers_text"]

FLUSH_S: Final = 0.25
"""Maximum time span of messages lost if the process is killed [s]."""
CHUNK_BYTES: Final = 1 << 20
_NS: Final = 1_000_000_000
_MEDIA: Final = {".json": "application/json", ".yaml": "application/yaml"}


class BagWriter:
    """One file; use it from one thread only."""

    def __init__(self, path: Path) -> None:
        """Create the file.

        Raises:
            CommandFailedError: the file already exists, or cannot be created.
        """
        try:
            self._file = path.open("xb")
        except FileExistsError as error:
            raise CommandFailedError(
                f"{path} already exists", help="choose another file with `--output`"
            ) from error
        except OSError as error:
            raise unwritable(path, error) from error
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES)
        self._writer.start(Profile.ROS2, library=f"obk {run_versions().get('obk', '')}".strip())
        self._schemas: dict[str, int] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the file; after a failure, everything written before it is readable."""
        if isinstance(error, OSError):
            # The disk has no room for an index.
            self._file.close()
        else:
            self.close()

    def describe(
        self,
        metadata: Mapping[str, Mapping[str, str]],
        attachments: Mapping[str, str],
        now_ns: int,
    ) -> None:
        """Write key-value records and text attachments by name, with this time [ns since 1970]."""
        for name, values in metadata.items():
            escaped = {_as_utf8(key): _as_utf8(value) for key, value in values.items()}
            self._writer.add_metadata(_as_utf8(name), escaped)
        for name, text in attachments.items():
            media = _MEDIA.get(Path(name).suffix, "text/plain")
            data = _as_utf8(text).encode()
            self._writer.add_attachment(now_ns, now_ns, _as_utf8(name), media, data)
        self._file.flush()

    def add_topic(
        self, topic: str, msg_type: str, definition: str, metadata: Mapping[str, str]
    ) -> int:
        """Add the channel of a topic; return its number.

        Args:
            topic: absolute name.
            msg_type: full name.
            definition: of the type and of all types that it refers to; empty if unknown.
            metadata: metadata of the channel.
        """
        if msg_type not in self._schemas:
            self._schemas[msg_type] = self._writer.register_schema(
                msg_type, SchemaEncoding.ROS2, definition.encode()
            )
        return self._writer.register_channel(
            topic, MessageEncoding.CDR, self._schemas[msg_type], dict(metadata)
        )

    def add_message(
        self, channel: int, data: bytes, received_ns: int, sent_ns: int, sequence: int
    ) -> None:
        """Write a message with its times [ns since 1970].

        Raises:
            OSError: the file cannot be written.
        """
        self._writer.add_message(channel, received_ns, data, sent_ns, sequence & 0xFFFFFFFF)

    def flush(self) -> None:
        """Write all messages so far.

        Raises:
            OSError: the file cannot be written.
        """
        self._writer.flush()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """Write the index and close the file.

        Raises:
            OSError: the file cannot be written; everything flushed before is readable.
        """
        with self._file:
            self._writer.finish()  # type: ignore[no-untyped-call]


def _as_utf8(text: str) -> str:
    """Escape characters that UTF-8 cannot encode, such as bytes of a file name."""
    return text.encode(errors="backslashreplace").decode()


def offers_text(offers: Iterable[OfferedQos]) -> str:
    """The offers as YAML, one per publisher, as rosbag2 reads them for playback.

    Source: rosbag2, `offered_qos_profiles` of a topic, metadata version 9.
    """
    return yaml.safe_dump([_profile(offer) for offer in offers], sort_keys=False)


def _profile(offer: OfferedQos) -> Mapping[str, object]:
    return {
        "history": offer.history,
        "depth": offer.depth,
        "reliability": offer.reliability,
        "durability": offer.durability,
        "deadline": _time(offer.deadline_ns),
        "lifespan": _time(offer.lifespan_ns),
        "liveliness": offer.liveliness,
        "liveliness_lease_duration": _time(offer.lease_ns),
        "avoid_ros_namespace_conventions": False,
    }


def _time(nanoseconds: int) -> Mapping[str, int]:
    return {"sec": nanoseconds // _NS, "nsec": nanoseconds % _NS}
