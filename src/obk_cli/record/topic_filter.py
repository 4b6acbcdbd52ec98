"""Select the topics to record by name and by pattern. Pure: the ROS graph comes in as a mapping."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

__all__ = ["RecordRequest", "clashing_topics", "matching_topics", "unmatched_requests"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordRequest:
    """Topics that the user asks to record."""

    topics: Mapping[str, str | None] = field(default_factory=dict)
    """Absolute name -> full type (`pkg/msg/Name`); None: the one that the graph reports."""
    patterns: tuple[str, ...] = ()
    """Shell-style patterns: `/arm/*`; `*` matches slashes too."""
    excludes: tuple[str, ...] = ()
    """Patterns of topics to leave out; they override `topics` and `patterns`."""


def matching_topics(
    request: RecordRequest, graph: Mapping[str, Sequence[str]]
) -> Mapping[str, str]:
    """The topics that can be recorded now, each with its type.

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
    """Sentences about the names and patterns that match none of the topics found."""
    for topic in request.topics:
        if topic not in found and not _is_excluded(request, topic):
            yield f"{topic} was not there"
    for pattern in request.patterns:
        if not any(_matches(topic, pattern) for topic in found):
            yield f"no topic fitted `{pattern}`"


def _candidates(
    request: RecordRequest, graph: Mapping[str, Sequence[str]]
) -> Iterator[tuple[str, str | None]]:
    """Requested topics, each with the type that the request gives for it."""
    fitting = (
        t for t in sorted(graph) if any(_matches(t, pattern) for pattern in request.patterns)
    )
    for topic in dict.fromkeys((*request.topics, *fitting)):
        if not _is_excluded(request, topic):
            yield topic, request.topics.get(topic)


def _is_excluded(request: RecordRequest, topic: str) -> bool:
    return any(fnmatchcase(topic, pattern) for pattern in request.excludes)


def _matches(topic: str, pattern: str) -> bool:
    """Hidden topics, such as those of actions, match only patterns that name hidden topics."""
    is_hidden = "/_" in topic
    return fnmatchcase(topic, pattern) and (not is_hidden or "/_" in pattern)


def _only(types: Sequence[str]) -> str | None:
    """The only type of a topic; None if it has none or several."""
    return types[0] if len(types) == 1 else None
