"""Which topics are recorded: those that are named, and those of the ROS graph that fit a pattern.

In: what the user wishes and what the graph has. Out: topic and type. Asks ROS nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

__all__ = ["Wish", "chosen_topics"]


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
    wanted = dict(wish.topics)
    for topic in sorted(graph):
        if any(_fits(topic, pattern) for pattern in wish.patterns):
            wanted.setdefault(topic, None)
    typed = {topic: kind or _only(graph.get(topic, ())) for topic, kind in wanted.items()}
    return {
        topic: kind
        for topic, kind in typed.items()
        if kind is not None and not any(fnmatchcase(topic, no) for no in wish.excludes)
    }


def _fits(topic: str, pattern: str) -> bool:
    """Hidden topics, such as those of actions, fit only a pattern that is about hidden ones."""
    is_hidden = "/_" in topic
    return fnmatchcase(topic, pattern) and (not is_hidden or "/_" in pattern)


def _only(types: Sequence[str]) -> str | None:
    """The type of a topic; None where there is none, or several, of which none is right."""
    return types[0] if len(types) == 1 else None
