"""The job of a recorder process, as a value and as JSON."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Final

from obk_cli.record.topic_filter import RecordRequest

__all__ = ["BEGUN", "RecorderJob", "job_from_json", "job_to_json"]

BEGUN: Final = "recording to "
"""Prefix of the line that a recorder prints once it is subscribed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderJob:
    """One recording."""

    path: Path
    """The file, which must not exist yet."""
    request: RecordRequest
    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """Metadata records at the start of the file, by name."""
    attachments: Mapping[str, str] = field(default_factory=dict)
    """Text attachments at the start of the file, by file name."""
    duration_s: float | None = None
    """How long to record [s]; None: until a signal ends it."""


def job_to_json(job: RecorderJob) -> str:
    """The job for another process."""
    return json.dumps({**asdict(job), "path": str(job.path)})


def job_from_json(text: str) -> RecorderJob:
    """The job that `job_to_json` wrote."""
    data = json.loads(text)
    request = data["request"]
    return RecorderJob(
        path=Path(data["path"]),
        request=RecordRequest(
            topics=request["topics"],
            patterns=tuple(request["patterns"]),
            excludes=tuple(request["excludes"]),
        ),
        metadata=data["metadata"],
        attachments=data["attachments"],
        duration_s=data["duration_s"],
    )
