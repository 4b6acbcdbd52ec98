"""A recorded run: its topics as arrays, its config, parameters and versions."""

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from obelisk_recordings.bag import Bag, RecordingError
from obelisk_recordings.chunks import TopicMessages, joined, messages_in_parts
from obelisk_recordings.find import find_recording, folder_of_runs
from obelisk_recordings.layout import MessageDefinition, parse_definition
from obelisk_recordings.summary import read_attachments, read_bag
from obelisk_recordings.topic import RecordedTopic
from obelisk_spec.suggestions import did_you_mean, list_names

__all__ = ["RecordedRun", "open_run", "topic_named"]

EVENTS_FILE: Final = "events.jsonl"
"""File beside the recording of a launch with events, such as when its stack became active."""
NS_PER_S: Final = 1_000_000_000
_TIMES_END: Final = 1 << 63
"""Times from here on do not fit into 64 bits with a sign; only damaged files have them [ns]."""


def topic_named(name: str, topics: Sequence[str]) -> str:
    """Return the topic that a name refers to: a full name, or a suffix of exactly one.

    Raises:
        RecordingError: no topic matches, or several do.
    """
    if name in topics:
        return name
    meant = [topic for topic in topics if topic.endswith(f"/{name.lstrip('/')}")]
    if len(meant) == 1:
        return meant[0]
    if meant:
        raise RecordingError(f"`{name}` matches several topics: {list_names(meant)}")
    raise RecordingError(
        f"the recording has no topic `{name}`",
        help=did_you_mean(name, topics) or f"it has {list_names(topics) or 'none'}",
    )


class RecordedRun:
    """A recording; `run["/robot/est"].q_joints` is an array with one row per message."""

    def __init__(self, path: Path) -> None:
        """Read the summary of the file; topics are read when they are accessed.

        Raises:
            RecordingError: the file cannot be read or is not an MCAP file.
        """
        self.path = path
        self.bag: Bag = read_bag(path)
        self._topics: dict[str, RecordedTopic] = {}

    def __repr__(self) -> str:
        return f"<{self.path}: {self.bag.count} messages of {len(self.bag.topics)} topics>"

    @property
    def name(self) -> str:
        """Name for display; a recording in a run's folder has the name of the run."""
        return self.path.parent.name if self.path.stem == "recording" else self.path.stem

    @property
    def topics(self) -> tuple[str, ...]:
        """Full names of the recorded topics."""
        return tuple(dict.fromkeys(topic.topic for topic in self.bag.topics))

    @property
    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """Information about the run: `obelisk`, `obelisk_versions`."""
        return self.bag.metadata

    @cached_property
    def attachments(self) -> Mapping[str, str]:
        """Text files in the recording: `plan.json`, `params/<node>.yaml`."""
        return read_attachments(self.path)

    @cached_property
    def plan(self) -> Mapping[str, Any]:
        """The compiled config; empty if the recording has none that can be read."""
        try:
            plan = json.loads(self.attachments.get("plan.json", "{}"))
        except (ValueError, RecursionError):
            return {}
        return plan if isinstance(plan, dict) else {}

    @cached_property
    def events(self) -> Sequence[Mapping[str, Any]]:
        """Events that the launcher stored beside the recording; empty if there are none."""
        try:
            lines = self.path.with_name(EVENTS_FILE).read_text(encoding="utf-8").splitlines()
        except (OSError, ValueError):
            return ()
        return tuple(event for line in lines if (event := _event(line)))

    @property
    def is_lockstep(self) -> bool:
        """Whether the run was in lockstep, with simulated times."""
        return self.metadata.get("obelisk", {}).get("lockstep") == "true"

    @cached_property
    def origin_ns(self) -> int:
        """Origin of times: when the stack became active [ns since 1970].

        In lockstep, it is the start of simulated time. Without the launcher's events, it is the
        time of the first message.
        """
        if self.is_lockstep:
            return 0
        for event in self.events:
            if event.get("event") == "StackState" and event.get("state") == "active":
                time = event.get("time")
                if isinstance(time, int | float) and abs(time) < 1 << 33:
                    return round(time * NS_PER_S)
        start_ns = self.bag.start_ns or 0
        return start_ns if start_ns < _TIMES_END else 0

    def __getitem__(self, name: str) -> RecordedTopic:
        """Return the messages of a topic, by its full name or a suffix; each is read only once.

        Raises:
            RecordingError: the topic does not exist, has no messages, or cannot be read.
        """
        topic = topic_named(name, self.topics)
        if topic not in self._topics:
            read = self.read([topic])
            if topic not in read:
                raise RecordingError(f"{self.path}: {topic} has no messages")
            self._topics[topic] = read[topic]
        return self._topics[topic]

    def read(self, topics: Iterable[str]) -> dict[str, RecordedTopic]:
        """Read some topics in one pass over the file; topics without messages are omitted.

        The result is not cached.

        Args:
            topics: full names.

        Raises:
            RecordingError: the file cannot be read, or a topic has messages of several types.
        """
        parts: dict[str, list[TopicMessages]] = {}
        for part in messages_in_parts(self.path, frozenset(topics), part_bytes=1 << 62):
            parts.setdefault(part.topic, []).append(part)
        for name, found in parts.items():
            if len(found) > 1:
                raise RecordingError(f"{self.path}: {name} has messages of several types")
        return {name: self._topic(joined(found)) for name, found in parts.items()}

    def definitions(self, topics: Iterable[str]) -> dict[str, MessageDefinition]:
        """Return the message definitions of those topics for which the recording has them.

        Args:
            topics: full names.

        Raises:
            RecordingError: the file cannot be read.
        """
        found: dict[str, MessageDefinition] = {}
        missing = set(topics)
        for part in messages_in_parts(self.path, frozenset(topics), part_bytes=0):
            if part.topic in missing and part.definition:
                found[part.topic] = parse_definition(part.msg_type, part.definition)
            missing.discard(part.topic)
            if not missing:
                break
        return found

    def parts(self, topics: Iterable[str]) -> Iterator[RecordedTopic]:
        """Read some topics in parts of limited size, for recordings that do not fit into memory.

        Args:
            topics: full names.

        Raises:
            RecordingError: the file cannot be read.
        """
        for part in messages_in_parts(self.path, frozenset(topics)):
            yield self._topic(part)

    def _topic(self, messages: TopicMessages) -> RecordedTopic:
        return RecordedTopic(messages, self.origin_ns, self._actuators.get(messages.topic, ()))

    @cached_property
    def processes(self) -> tuple[Mapping[str, Any], ...]:
        """The processes in the plan; none if the recording has no plan."""
        found = self.plan.get("processes")
        processes = found if isinstance(found, list) else ()
        return tuple(process for process in processes if isinstance(process, dict))

    @cached_property
    def _actuators(self) -> Mapping[str, Sequence[tuple[str, str]]]:
        """Name and unit of each actuator of the simulator that subscribes to a topic."""
        with suppress(TypeError, KeyError, AttributeError):  # of an older version
            return {
                end["topic"]: [(str(one["name"]), str(one["unit"])) for one in node["actuators"]]
                for node in self.plan["processes"]
                if node["actuators"]
                for end in node["subscribes"]
            }
        return {}


def _event(line: str) -> Mapping[str, Any]:
    try:
        event = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return event if isinstance(event, dict) else {}


def open_run(run: str | os.PathLike[str]) -> RecordedRun:
    """Open a recording.

    Args:
        run: an MCAP file, a folder with one, the name of a config (its most recent recorded run on
            this machine; with the suffix `~1`, the one before), or of a run's folder.

    Raises:
        RecordingError: the recording does not exist or cannot be read.
    """
    return RecordedRun(find_recording(folder_of_runs(os.environ), os.fspath(run)))
