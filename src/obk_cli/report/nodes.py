"""Nodes for a person and for a program."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from obelisk_spec.suggestions import with_number
from obk_cli.introspect.graph_model import special_services
from obk_cli.introspect.nodes import NodeSeen
from obk_cli.report.escapes import plain
from obk_cli.report.node_status import status_text
from obk_cli.runs.protocol import NodeStatus

__all__ = ["node_data", "node_text", "nodes_data", "nodes_text"]


def nodes_text(nodes: Iterable[str], known: Mapping[str, NodeStatus]) -> Iterator[str]:
    """A line for each node."""
    every = tuple(nodes)
    width = max(map(len, every), default=0)
    for node in every:
        words = f"{node:<{width}}  {status_text(known[node])}" if node in known else node
        yield plain(words)


def nodes_data(nodes: Iterable[str], known: Mapping[str, NodeStatus]) -> list[dict[str, Any]]:
    """An object for each node."""
    return [{"node": node, **_status_data(known.get(node))} for node in nodes]


def node_text(seen: NodeSeen) -> Iterator[str]:
    """The lines on one node."""
    yield plain(f"{seen.node}{f': {seen.state}' if seen.state else ''}")
    if seen.status is not None:
        yield f"  run {plain(seen.run or '')}, {status_text(seen.status)}"
    asked = f"{seen.node}/list_parameters" in seen.services
    unknown = "no answer" if asked else "it tells of none"
    yield f"  parameters: {unknown if seen.parameters is None else seen.parameters}"
    own = special_services(seen.services)
    for title, names in (
        ("publishes", seen.publishes),
        ("subscribes to", seen.subscribes),
        ("serves", own),
    ):
        yield f"  {title}: {len(names)}"
        width = max(map(len, names), default=0)
        for name, types in names.items():
            yield plain(f"    {name:<{width}}  {', '.join(types)}")
    if len(own) < len(seen.services):
        others = with_number(len(seen.services) - len(own), "service")
        yield f"  and {others} for its parameters"


def node_data(seen: NodeSeen) -> dict[str, Any]:
    """One node as an object."""
    return {
        "node": seen.node,
        "run": seen.run,
        **_status_data(seen.status),
        "state": seen.state,
        "parameters": seen.parameters,
        "publishes": {name: list(types) for name, types in seen.publishes.items()},
        "subscribes": {name: list(types) for name, types in seen.subscribes.items()},
        "services": {name: list(types) for name, types in seen.services.items()},
    }


def _status_data(node: NodeStatus | None) -> dict[str, Any]:
    return {
        "state": node.state if node else None,
        "pid": node.pid if node else None,
        "hangs": node.hangs if node else None,
        "restarts": node.restarts if node else None,
    }
