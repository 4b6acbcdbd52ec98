"""A ROS graph for a person and for a program: topics with their ends, services."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from obelisk_spec.suggestions import with_number
from obk_cli.introspect.graph_model import End, RosGraph, TopicSeen, misfits
from obk_cli.report.escapes import plain

__all__ = ["services_text", "topic_data", "topic_text", "topics_data", "topics_text"]

UNNAMED = "(a node whose name was not told)"


def topics_text(graph: RosGraph) -> Iterator[str]:
    """A line for each topic: name, type, how many ends."""
    rows = [
        (
            topic.name,
            ", ".join(topic.msg_types),
            f"{with_number(len(topic.publishers), 'publisher')}, "
            f"{with_number(len(topic.subscriptions), 'subscription')}",
        )
        for topic in graph.topics
    ]
    return _columns(rows)


def topics_data(graph: RosGraph) -> list[dict[str, Any]]:
    """The topics, with how many ends each has."""
    return [
        {
            "topic": topic.name,
            "types": list(topic.msg_types),
            "publishers": len(topic.publishers),
            "subscriptions": len(topic.subscriptions),
        }
        for topic in graph.topics
    ]


def services_text(services: Mapping[str, tuple[str, ...]]) -> Iterator[str]:
    """A line for each service: name, type."""
    return _columns([(name, ", ".join(types)) for name, types in services.items()])


def topic_text(topic: TopicSeen) -> Iterator[str]:
    """The lines on one topic: type, ends with their quality of service, ends that do not fit."""
    yield plain(f"{topic.name}: {', '.join(topic.msg_types) or 'no type'}")
    for title, ends in (("publishers", topic.publishers), ("subscriptions", topic.subscriptions)):
        yield f"{title}: {len(ends)}"
        yield from (f"  {line}" for line in _columns([_row(end) for end in ends]))
    hashes = {end.type_hash for end in topic.publishers + topic.subscriptions if end.type_hash}
    yield from (f"type hash: {one}" for one in sorted(hashes))
    yield from (f"warning: {plain(sentence)}" for sentence in misfits(topic))


def topic_data(topic: TopicSeen) -> dict[str, Any]:
    """One topic with its ends."""
    return {
        "topic": topic.name,
        "types": list(topic.msg_types),
        "publishers": [_end_data(end) for end in topic.publishers],
        "subscriptions": [_end_data(end) for end in topic.subscriptions],
        "misfits": list(misfits(topic)),
    }


def _row(end: End) -> tuple[str, ...]:
    qos = end.qos
    # What a node keeps is not told over the network: zero stands for that.
    depth = f" {qos.depth}" if qos.depth else ""
    history = f"{qos.history}{depth}" if qos.history != "unknown" else ""
    words = (qos.reliability, qos.durability, history, *_times(end))
    return (end.node or UNNAMED, end.msg_type, ", ".join(word for word in words if word))


def _times(end: End) -> Iterator[str]:
    limits = {"deadline": end.qos.deadline_ns, "lifespan": end.qos.lifespan_ns}
    for name, limit_ns in limits.items():
        if 0 < limit_ns < 2**63 - 1:
            yield f"{name} {limit_ns * 1e-6:g} ms"


def _end_data(end: End) -> dict[str, Any]:
    return {
        "node": end.node or None,
        "type": end.msg_type,
        "type_hash": end.type_hash or None,
        "reliability": end.qos.reliability,
        "durability": end.qos.durability,
        "deadline_ns": end.qos.deadline_ns,
        "lifespan_ns": end.qos.lifespan_ns,
        "liveliness": end.qos.liveliness,
    }


def _columns(rows: Sequence[tuple[str, ...]]) -> Iterator[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True))
        yield plain("  ".join(cells).rstrip())
