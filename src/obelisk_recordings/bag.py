"""The summary of a recording, and the error for an unreadable one, without importing libraries."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

__all__ = ["DROPS", "Bag", "BagTopic", "RecordingError"]


DROPS: Final = "obelisk_drops"
"""The metadata record with the number of lost messages by topic."""


class RecordingError(LookupError):
    """A recording cannot be read or lacks a topic or field; the message is for the user."""

    exit_code = 1

    def __init__(self, message: str, *, help: str | None = None) -> None:
        super().__init__(f"{message}: {help}" if help else message)
        self.message = message
        self.help = help


@dataclass(frozen=True, slots=True, kw_only=True)
class BagTopic:
    """One topic of a recording."""

    topic: str
    msg_type: str
    count: int
    lost: int | None = None
    """Messages that the recorder missed; None if unknown."""
    type_hash: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bag:
    """The summary of a recording."""

    path: str
    size_bytes: int
    profile: str
    library: str
    is_complete: bool
    """Whether the recorder closed it; otherwise it contains everything written until it ended."""
    start_ns: int | None
    """Time of the first message [ns since 1970]; None if it has no messages."""
    end_ns: int | None
    topics: tuple[BagTopic, ...]
    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    attachments: Mapping[str, int] = field(default_factory=dict)
    """Name -> size [bytes]."""

    @property
    def duration_s(self) -> float:
        """Time from the first message to the last [s]."""
        return ((self.end_ns or 0) - (self.start_ns or 0)) * 1e-9

    @property
    def count(self) -> int:
        """Number of messages."""
        return sum(topic.count for topic in self.topics)
