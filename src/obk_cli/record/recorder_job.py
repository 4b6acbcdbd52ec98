"""The job of a recorder process: topics, file, and metadata about the run, as a value and as JSON.

This module does not need the MCAP library.
"""

import json
import subprocess
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final

from obelisk_recordings.find import config_of, run_name
from obelisk_spec.runtime_protocol import CLOCK_TOPIC
from obk_cli.runs.folder import read_record

__all__ = [
    "BEGUN",
    "RecordRequest",
    "RecorderJob",
    "RunMetadata",
    "clashing_topics",
    "file_name",
    "job_from_json",
    "job_to_json",
    "matching_topics",
    "run_metadata_of",
    "unmatched_requests",
]


PLAN_FILE: Final = "plan.json"
GIT_S: Final = 2.0
"""Limit for git [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordRequest:
    """Topics that the user wants to record."""

    topics: Mapping[str, str | None] = field(default_factory=dict)
    """Absolute name -> full type (`pkg/msg/Name`); None: the type in the graph."""
    patterns: tuple[str, ...] = ()
    """Shell-style patterns: `/arm/*`; `*` matches slashes too."""
    excludes: tuple[str, ...] = ()
    """Patterns of topics to leave out; they override `topics` and `patterns`."""


def matching_topics(
    request: RecordRequest, graph: Mapping[str, Sequence[str]]
) -> Mapping[str, str]:
    """The topics that can be recorded now, with their types.

    Args:
        request: topics and patterns to record.
        graph: absolute names of the existing topics, with their types.
    """
    typed = {
        topic: kind or _only(graph.get(topic, ())) for topic, kind in _candidates(request, graph)
    }
    return {topic: kind for topic, kind in typed.items() if kind is not None}


def clashing_topics(
    request: RecordRequest, graph: Mapping[str, Sequence[str]]
) -> Mapping[str, Sequence[str]]:
    """The topics that cannot be recorded because they have several types, with those types."""
    untyped = (topic for topic, kind in _candidates(request, graph) if kind is None)
    return {topic: graph[topic] for topic in untyped if len(graph.get(topic, ())) > 1}


def unmatched_requests(request: RecordRequest, found: Collection[str]) -> Iterator[str]:
    """Sentences about requested names and patterns that match no topic."""
    for topic in request.topics:
        if topic not in found and not _is_excluded(request, topic):
            yield f"{topic} was not found"
    for pattern in request.patterns:
        if not any(_matches(topic, pattern) for topic in found):
            yield f"no topic matched `{pattern}`"


def _candidates(
    request: RecordRequest, graph: Mapping[str, Sequence[str]]
) -> Iterator[tuple[str, str | None]]:
    """Requested topics, with the type that the request gives for each."""
    fitting = (
        t for t in sorted(graph) if any(_matches(t, pattern) for pattern in request.patterns)
    )
    for topic in dict.fromkeys((*request.topics, *fitting)):
        if not _is_excluded(request, topic):
            yield topic, request.topics.get(topic)


def _is_excluded(request: RecordRequest, topic: str) -> bool:
    return any(fnmatchcase(topic, pattern) for pattern in request.excludes)


def _matches(topic: str, pattern: str) -> bool:
    """Hidden topics, such as those of actions, match only patterns that name hidden topics.

    `/clock` matches only patterns that name it: a subscription makes the simulator publish it at
    1 kHz, and each message has its time in its header already.
    """
    if not fnmatchcase(topic, pattern):
        return False
    if topic == CLOCK_TOPIC:
        return "clock" in pattern
    return "/_" not in topic or "/_" in pattern


def _only(types: Sequence[str]) -> str | None:
    """The only type of a topic; None if it has none or several."""
    return types[0] if len(types) == 1 else None


BEGUN: Final = "recording to "
"""Prefix of the line that a recorder prints once it has subscribed."""


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
    """Duration [s]; None: until a signal."""


def job_to_json(job: RecorderJob) -> str:
    """Serialize the job for another process."""
    return json.dumps({**asdict(job), "path": str(job.path)})


def job_from_json(text: str) -> RecorderJob:
    """Parse the output of `job_to_json`."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class RunMetadata:
    """Metadata records and attachments at the start of a recording."""

    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    attachments: Mapping[str, str] = field(default_factory=dict)


def file_name(folder: Path | None, when: datetime) -> str:
    """The default name of a recording's file."""
    return f"{run_name(config_of(folder) if folder else 'ros', when)}.mcap"


def run_metadata_of(folder: Path) -> RunMetadata:
    """The metadata of a run; omits what its folder lacks."""
    run = read_record(folder)
    stored = {
        key: str(run[key]) for key in ("name", "config", "domain", "plan_sha256") if key in run
    }
    recorded_versions = run.get("versions")
    every = recorded_versions.items() if isinstance(recorded_versions, dict) else ()
    versions = {key: str(value) for key, value in every}
    plan = {PLAN_FILE: json.dumps(run["plan"], indent=1)} if "plan" in run else {}
    code = {"obelisk_code": found} if (found := _code(run.get("config"))) else {}
    return RunMetadata(
        metadata={
            "obelisk": {"run": folder.name, **stored},
            "obelisk_versions": versions,
            **code,
        },
        attachments={**plan, **_parameters(folder)},
    )


def _code(config: object) -> Mapping[str, str]:
    """The commit of a config's workspace; empty outside a git repository."""
    if not isinstance(config, str):
        return {}
    command = ["git", "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        described = subprocess.run(
            command,
            cwd=Path(config).parent,
            capture_output=True,
            text=True,
            timeout=GIT_S,
            check=True,
        )
    except (OSError, ValueError, subprocess.SubprocessError):
        return {}
    return {"commit": described.stdout.strip()}


def _parameters(folder: Path) -> Mapping[str, str]:
    texts = {}
    for path in sorted((folder / "params").glob("*.yaml")):
        texts[f"params/{path.name}"] = path.read_text(encoding="utf-8", errors="replace")
    return texts
