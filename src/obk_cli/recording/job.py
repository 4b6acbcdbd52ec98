"""What a recorder is told to do, as a value and as JSON: the recorder is a process of its own."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Final

from obk_cli.recording.choice import Wish

__all__ = ["BEGUN", "Job", "job_from_json", "job_to_json"]

BEGUN: Final = "recording to "
"""How the line begins by which a recorder tells that it listens."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One recording."""

    path: Path
    """The file, which is not there yet."""
    wish: Wish
    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """Metadata records that stand first in the file, by name."""
    attachments: Mapping[str, str] = field(default_factory=dict)
    """Texts that stand first in the file, by file name."""
    duration_s: float | None = None
    """How long to record [s]; None: until asked to stop."""


def job_to_json(job: Job) -> str:
    """The job for another process."""
    return json.dumps({**asdict(job), "path": str(job.path)})


def job_from_json(text: str) -> Job:
    """The job that `job_to_json` wrote."""
    told = json.loads(text)
    wish = told["wish"]
    return Job(
        path=Path(told["path"]),
        wish=Wish(
            topics=wish["topics"],
            patterns=tuple(wish["patterns"]),
            excludes=tuple(wish["excludes"]),
        ),
        metadata=told["metadata"],
        attachments=told["attachments"],
        duration_s=told["duration_s"],
    )
