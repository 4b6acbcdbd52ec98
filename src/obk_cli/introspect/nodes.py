"""Show nodes, topics and services of a ROS graph as text and as data."""

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import Any

from obelisk_spec.suggestions import with_number
from obk_cli.errors import CommandFailedError
from obk_cli.introspect.graph_source import GraphSource, parameters_of
from obk_cli.introspect.target import GraphTarget
from obk_cli.ros.graph import (
    GET_STATE,
    GraphEndpoint,
    GraphSnapshot,
    TopicInfo,
    ends_that_need_dds,
    incompatible_endpoints,
    special_services,
)
from obk_cli.runs.protocol import NodeStatus, ask_status
from obk_cli.runs.registry import status_text
from obk_cli.terminal import plain

__all__ = [
    "NodeInfo",
    "inspect_node",
    "known_nodes",
    "node_data",
    "node_text",
    "nodes_data",
    "nodes_text",
    "services_text",
    "topic_data",
    "topic_text",
    "topics_data",
    "topics_text",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeInfo:
    """Information about a node."""

    node: str
    """Full name."""
    publishes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Topic -> types."""
    subscribes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    services: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    parameters: int | None = None
    """Number of parameters; None if the node does not answer."""
    state: str | None = None
    """Lifecycle state; None if it has none, or does not answer."""
    status: NodeStatus | None = None
    """The status from its launcher, if that runs on this host."""
    run: str | None = None
    """The run folder's name."""


def known_nodes(target: GraphTarget) -> Mapping[str, NodeStatus]:
    """Status of nodes by full name, as reported by the launchers on this host."""
    statuses = (ask_status(folder) for folder in target.runs)
    return {node.node: node for status in statuses if status for node in status.nodes}


def inspect_node(source: GraphSource, target: GraphTarget, node: str, timeout_s: float) -> NodeInfo:
    """Collect everything known about a node, even if it does not answer.

    Args:
        source: the graph.
        target: the runs whose launchers are queried.
        node: full name.
        timeout_s: limit for each answer of the node [s].
    """
    publishes, subscribes = source.topics_of(node)
    services = source.services_of(node)
    status = known_nodes(target).get(node)
    state = status.state if status else None
    if state is None and GET_STATE in services.get(f"{node}/get_state", ()):
        state = _state(source, node, timeout_s)
    runs = [folder.name for folder, run in target.runs.items() if node in run.all_nodes]
    return NodeInfo(
        node=node,
        publishes=publishes,
        subscribes=subscribes,
        services=services,
        parameters=_parameters(source, node, timeout_s),
        state=state,
        status=status,
        run=runs[0] if runs else None,
    )


def _state(source: GraphSource, node: str, timeout_s: float) -> str | None:
    from obk_cli.ros.participant import RosParticipant
    from obk_cli.ros.services import ServiceClient
    from obk_cli.ros.types import find_type

    if not isinstance(source, RosParticipant):  # the launcher has already reported its nodes
        return None
    kind = find_type(GET_STATE)
    try:
        client = ServiceClient(source, f"{node}/get_state", kind)
        return str(client.call(kind.Request(), timeout_s, is_question=True).current_state.label)
    except CommandFailedError:
        return None


def _parameters(source: GraphSource, node: str, timeout_s: float) -> int | None:
    if f"{node}/list_parameters" not in source.service_types():
        return None
    try:
        return len(parameters_of(source, node, timeout_s).names())
    except CommandFailedError:
        return None


UNNAMED = "(a node without a known name)"


def topics_text(graph: GraphSnapshot) -> Iterator[str]:
    """A line for each topic: name, type, number of publishers and subscriptions."""
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


def topics_data(graph: GraphSnapshot) -> list[dict[str, Any]]:
    """The topics, with the number of publishers and subscriptions."""
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


def topic_text(topic: TopicInfo, sockets: Set[str] | None = None) -> Iterator[str]:
    """The lines about one topic: type, endpoints with their QoS, incompatible endpoints.

    Args:
        topic: the discovered topic.
        sockets: see `ends_that_need_dds`; None if no run is known: the transport is not shown.
    """
    yield plain(f"{topic.name}: {', '.join(topic.msg_types) or 'no type'}")
    for title, endpoints in (
        ("publishers", topic.publishers),
        ("subscriptions", topic.subscriptions),
    ):
        yield f"{title}: {len(endpoints)}"
        yield from (f"  {line}" for line in _columns([_row(end) for end in endpoints]))
    hashes = {end.type_hash for end in topic.publishers + topic.subscriptions if end.type_hash}
    yield from (f"type hash: {one}" for one in sorted(hashes))
    if sockets is not None and topic.publishers and topic.subscriptions:
        reasons = "; ".join(ends_that_need_dds(topic, sockets))
        yield plain(f"transport: {f'DDS, as {reasons}' if reasons else 'local sockets'}")
    yield from (f"warning: {plain(sentence)}" for sentence in incompatible_endpoints(topic))


def topic_data(topic: TopicInfo, sockets: Set[str] | None = None) -> dict[str, Any]:
    """One topic with its endpoints; arguments as for `topic_text`."""
    return {
        "topic": topic.name,
        "types": list(topic.msg_types),
        "publishers": [_endpoint_data(end) for end in topic.publishers],
        "subscriptions": [_endpoint_data(end) for end in topic.subscriptions],
        "misfits": list(incompatible_endpoints(topic)),
        "needs_dds": None if sockets is None else list(ends_that_need_dds(topic, sockets)),
    }


def _row(end: GraphEndpoint) -> tuple[str, ...]:
    qos = end.qos
    # Queue depths are not announced over the network; they are reported as zero.
    depth = f" {qos.depth}" if qos.depth else ""
    history = f"{qos.history}{depth}" if qos.history != "unknown" else ""
    words = (qos.reliability, qos.durability, history, *_times(end))
    return (end.node or UNNAMED, end.msg_type, ", ".join(word for word in words if word))


def _times(end: GraphEndpoint) -> Iterator[str]:
    limits = {"deadline": end.qos.deadline_ns, "lifespan": end.qos.lifespan_ns}
    for name, limit_ns in limits.items():
        if 0 < limit_ns < 2**63 - 1:
            yield f"{name} {limit_ns * 1e-6:g} ms"


def _endpoint_data(end: GraphEndpoint) -> dict[str, Any]:
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


def node_text(seen: NodeInfo) -> Iterator[str]:
    """The lines about one node."""
    yield plain(f"{seen.node}{f': {seen.state}' if seen.state else ''}")
    if seen.status is not None:
        yield f"  run {plain(seen.run or '')}, {status_text(seen.status)}"
    has_parameters = f"{seen.node}/list_parameters" in seen.services
    unknown = "no answer" if has_parameters else "not reported"
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


def node_data(seen: NodeInfo) -> dict[str, Any]:
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
