"""Which topics are recorded: those that are named, and those of the ROS graph that fit a pattern.

In: what the user wishes and what the graph has. Out: topic and type. Asks ROS nothing.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

__all__ = ["Wish", "chosen_topics", "clashing_topics", "unmet_wishes"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """What is to be recorded."""

    topics: Mapping[str, str | None] = field(default_factory=dict)
    """Absolute name -> full type (`pkg/msg/Name`); None: the one that the graph tells."""
    patterns: tuple[str, ...] = ()
    """As of file names: `/arm/*`; `*` matches slashes too."""
    excludes: tuple[str, ...] = ()
    """Patterns of what is left out, whatever else names it."""


def chosen_topics(wish: Wish, graph: Mapping[str, Sequence[str]]) -> Mapping[str, str]:
    """The topics that can be recorded by now, each with its type.

    Args:
        wish: what is to be recorded.
        graph: absolute names of the topics that are there, with their types.
    """
    typed = {topic: kind or _only(graph.get(topic, ())) for topic, kind in _wanted(wish, graph)}
    return {topic: kind for topic, kind in typed.items() if kind is not None}


def clashing_topics(wish: Wish, graph: Mapping[str, Sequence[str]]) -> Mapping[str, Sequence[str]]:
    """The topics that cannot be recorded because they have several types, with these."""
    untyped = (topic for topic, kind in _wanted(wish, graph) if kind is None)
    return {topic: graph[topic] for topic in untyped if len(graph.get(topic, ())) > 1}


def unmet_wishes(wish: Wish, found: Collection[str]) -> Iterator[str]:
    """Sentences on the names and patterns that none of the topics found has, or fits."""
    for topic in wish.topics:
        if topic not in found and not _is_excluded(wish, topic):
            yield f"{topic} was not there"
    for pattern in wish.patterns:
        if not any(_fits(topic, pattern) for topic in found):
            yield f"no topic fitted `{pattern}`"


def _wanted(wish: Wish, graph: Mapping[str, Sequence[str]]) -> Iterator[tuple[str, str | None]]:
    """Topics and the types that the wish has for them."""
    fitting = (t for t in sorted(graph) if any(_fits(t, pattern) for pattern in wish.patterns))
    for topic in dict.fromkeys((*wish.topics, *fitting)):
        if not _is_excluded(wish, topic):
            yield topic, wish.topics.get(topic)


def _is_excluded(wish: Wish, topic: str) -> bool:
    return any(fnmatchcase(topic, pattern) for pattern in wish.excludes)


def _fits(topic: str, pattern: str) -> bool:
    """Hidden topics, such as those of actions, fit only a pattern that is about hidden ones."""
    is_hidden = "/_" in topic
    return fnmatchcase(topic, pattern) and (not is_hidden or "/_" in pattern)


def _only(types: Sequence[str]) -> str | None:
    """The type of a topic; None where there is none, or several, of which none is right."""
    return types[0] if len(types) == 1 else None
