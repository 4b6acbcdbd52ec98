"""Read the ROS graph: nodes by name, publishers and subscriptions by topic.

The graph contains what DDS has discovered so far. A participant is discovered by its next
announcement: within 0.3 s for obk's nodes, which announce themselves often
(`dds_localhost.xml`), and within 3.1 s for others, which by default do so every 3 s.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal

from obk_cli.ros.raw_subscription import OfferedQos, RequestedQos

__all__ = [
    "FOREIGN_DISCOVERY_S",
    "GET_STATE",
    "OWN_DISCOVERY_S",
    "UNNAMED",
    "GraphEndpoint",
    "GraphSnapshot",
    "Role",
    "RosGraph",
    "TopicInfo",
    "ends_that_need_dds",
    "full_name",
    "incompatible_endpoints",
    "parameter_nodes",
    "special_services",
    "visible",
]

OWN_DISCOVERY_S: Final = 0.4
"""Limit for discovering nodes that obk started [s]."""
FOREIGN_DISCOVERY_S: Final = 3.3
"""Limit for discovering any node with the middleware's default settings [s]."""
UNNAMED: Final = "(a participant without a node's name)"
"""A publisher of another DDS program, or of a node whose name is not known yet."""
GET_STATE: Final = "lifecycle_msgs/srv/GetState"
NAME_UNKNOWN: Final = "_NODE_NAME_UNKNOWN_"
POLL_S: Final = 0.01


class RosGraph:
    """The graph as seen by one node; every wait has a limit."""

    def __init__(self, node: Any, begin_s: float | None = None) -> None:
        """Start discovery.

        Args:
            node: the rclpy node.
            begin_s: when its participant started discovery (monotonic [s]); None: just now.
        """
        self._node = node
        self._begin = time.monotonic() if begin_s is None else begin_s

    def find(self, expected: Iterable[str], timeout_s: float, quiet_s: float) -> tuple[str, ...]:
        """Full names of the lifecycle nodes in the graph.

        It returns as soon as all expected nodes exist. If none are expected, it returns when there
        are some and the graph has not changed for `quiet_s`. It returns after `timeout_s` in any
        case.
        """
        required = frozenset(expected)
        end = time.monotonic() + timeout_s
        seen: frozenset[str] = frozenset()
        changed = time.monotonic()
        while (now := time.monotonic()) < end:
            found = frozenset(self._life_cycle_nodes())
            if found != seen:
                seen, changed = found, now
            is_quiet = bool(seen) and now - changed > quiet_s
            if (required and required <= seen) or (not required and is_quiet):
                break
            time.sleep(POLL_S)
        return tuple(sorted(seen))

    def taken(self, names: Iterable[str], discovery_s: float) -> tuple[str, ...]:
        """The names in `names` that other nodes in the graph already have.

        It returns when there are some, or `discovery_s` after discovery began.
        """
        taken = frozenset(names)

        def found() -> tuple[str, ...]:
            there = self._node.get_node_names_and_namespaces()
            return tuple(sorted(taken & {full_name(name, space) for name, space in there}))

        self._wait(lambda: bool(found()), discovery_s)
        return found()

    def foreign_publishers(
        self, topics: Iterable[str], ours: Iterable[str], discovery_s: float
    ) -> tuple[tuple[str, str], ...]:
        """Publishers on these topics by other nodes: topic and the node's full name.

        It returns when there are some, or `discovery_s` after discovery began. A node whose name is
        not known by then is `UNNAMED`.

        Args:
            topics: absolute names.
            ours: full names of nodes that may publish on them.
            discovery_s: `OWN_DISCOVERY_S` for nodes of other stacks, `FOREIGN_DISCOVERY_S` for all.
        """
        listed, allowed = tuple(topics), frozenset(ours)

        def found() -> set[tuple[str, str]]:
            return {(t, name) for t in listed for name in self._publishers(t)} - {
                (t, name) for t in listed for name in allowed
            }

        self._wait(lambda: any(name != UNNAMED for _, name in found()), discovery_s)
        return tuple(sorted(found()))

    def topic_types(self) -> Mapping[str, Sequence[str]]:
        """Topic -> the full types of its publishers and subscriptions."""
        return dict(self._node.get_topic_names_and_types())

    def ends_of_type(self, topic: str, msg_type: str) -> tuple[str, ...]:
        """Full names of the nodes that publish or subscribe to a topic with this type."""
        node = self._node
        endpoints = (
            *node.get_publishers_info_by_topic(topic),
            *node.get_subscriptions_info_by_topic(topic),
        )
        return tuple(sorted({_name_of(end) for end in endpoints if end.topic_type == msg_type}))

    def _publishers(self, topic: str) -> Iterator[str]:
        yield from map(_name_of, self._node.get_publishers_info_by_topic(topic))

    def _life_cycle_nodes(self) -> Iterator[str]:
        for service, types in self._node.get_service_names_and_types():
            if service.endswith("/get_state") and GET_STATE in types:
                yield service.removesuffix("/get_state")

    def _wait(self, condition: Callable[[], bool], discovery_s: float) -> None:
        while not condition() and time.monotonic() < self._begin + discovery_s:
            time.sleep(POLL_S)


def _name_of(end: Any) -> str:
    return full_name(end.node_name, end.node_namespace) or UNNAMED


def full_name(name: str, namespace: str) -> str:
    """A node's name in the graph, `/ns/name`; empty if the middleware does not know it."""
    return "" if name == NAME_UNKNOWN else f"{namespace.rstrip('/')}/{name}"


Role = Literal["publisher", "subscription"]
OF_EVERY_NODE: Final = ("rcl_interfaces/", "type_description_interfaces/")
PARAMETER_LIST: Final = "rcl_interfaces/srv/ListParameters"


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphEndpoint:
    """A publisher or subscription of a topic."""

    node: str
    """Full name; empty if unknown."""
    role: Role
    msg_type: str
    """Full, `pkg/msg/Name`."""
    qos: OfferedQos
    """Offered by a publisher, requested by a subscription."""
    type_hash: str = ""
    gid: str = ""
    """Hexadecimal; empty if unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicInfo:
    """A topic with its publishers and subscriptions."""

    name: str
    msg_types: tuple[str, ...]
    """More than one only if nodes use different types."""
    publishers: tuple[GraphEndpoint, ...] = ()
    subscriptions: tuple[GraphEndpoint, ...] = ()

    @property
    def published_types(self) -> tuple[str, ...]:
        """The types of the publishers."""
        return tuple(dict.fromkeys(end.msg_type for end in self.publishers)) or self.msg_types


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphSnapshot:
    """The graph as discovered by a node so far."""

    nodes: tuple[str, ...] = ()
    """Full names; a name shared by two nodes occurs twice."""
    topics: tuple[TopicInfo, ...] = ()
    services: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Full name -> types (`pkg/srv/Name`)."""

    def topic(self, name: str) -> TopicInfo:
        """The topic with this name; without endpoints if it does not exist."""
        empty = TopicInfo(name=name, msg_types=())
        return next((topic for topic in self.topics if topic.name == name), empty)


def visible(graph: GraphSnapshot) -> GraphSnapshot:
    """The graph without names hidden by ROS convention: those with a part that starts with `_`."""
    return replace(
        graph,
        topics=tuple(topic for topic in graph.topics if "/_" not in topic.name),
        services={name: types for name, types in graph.services.items() if "/_" not in name},
    )


def parameter_nodes(graph: GraphSnapshot) -> tuple[str, ...]:
    """Full names of the nodes that have parameter services."""
    return tuple(
        name.removesuffix("/list_parameters")
        for name, types in graph.services.items()
        if PARAMETER_LIST in types
    )


def special_services(services: Mapping[str, tuple[str, ...]]) -> Mapping[str, tuple[str, ...]]:
    """The services, except those that every node has for parameters and type descriptions."""
    return {
        name: types
        for name, types in services.items()
        if not any(one.startswith(OF_EVERY_NODE) for one in types)
    }


def ends_that_need_dds(topic: TopicInfo, sockets: Set[str]) -> Iterator[str]:
    """Ends that prevent a topic from using sockets only, with the reason.

    Args:
        topic: the discovered topic.
        sockets: GIDs of the subscriptions with a socket in a run on this host.
    """
    for end in topic.publishers:
        if end.qos.durability != "volatile":
            yield f"{end.node or UNNAMED} offers {end.qos.durability}"
    for end in topic.subscriptions:
        if end.gid not in sockets:
            yield f"{end.node or UNNAMED} has no socket in a run"


def incompatible_endpoints(topic: TopicInfo) -> Iterator[str]:
    """Sentences on publishers and subscriptions with incompatible types or QoS."""
    for publisher in topic.publishers:
        for subscription in topic.subscriptions:
            subscriber, sender = (end.node or "a node" for end in (subscription, publisher))
            who = f"{subscriber} does not receive from {sender}: "
            if publisher.msg_type != subscription.msg_type:
                yield f"{who}{subscription.msg_type} is not {publisher.msg_type}"
            asks, offers = _request(subscription.qos), _request(publisher.qos)
            if asks.is_reliable and not offers.is_reliable:
                yield f"{who}it requests `reliable`, but `best_effort` is offered"
            if asks.is_transient_local and not offers.is_transient_local:
                yield f"{who}it requests `transient_local`, but `volatile` is offered"


def _request(qos: OfferedQos) -> RequestedQos:
    return RequestedQos(
        is_reliable=qos.reliability == "reliable",
        is_transient_local=qos.durability == "transient_local",
    )
