"""What is in a ROS graph, as values: nodes, topics with their two ends, services."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Literal

from obk_cli.ros.raw_subscription import Offer, Request

__all__ = [
    "End",
    "Role",
    "RosGraph",
    "TopicSeen",
    "misfits",
    "parameter_nodes",
    "special_services",
    "visible",
]

Role = Literal["publisher", "subscription"]
OF_EVERY_NODE: Final = ("rcl_interfaces/", "type_description_interfaces/")
PARAMETER_LIST: Final = "rcl_interfaces/srv/ListParameters"


@dataclass(frozen=True, slots=True, kw_only=True)
class End:
    """One publisher or subscription of a topic."""

    node: str
    """Full name; empty where it was not told."""
    role: Role
    msg_type: str
    """Full, `pkg/msg/Name`."""
    qos: Offer
    """What a publisher offers, what a subscription asks for."""
    type_hash: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicSeen:
    """A topic with its ends."""

    name: str
    msg_types: tuple[str, ...]
    """More than one only where nodes do not agree."""
    publishers: tuple[End, ...] = ()
    subscriptions: tuple[End, ...] = ()

    @property
    def heard_types(self) -> tuple[str, ...]:
        """What is published, whatever the subscriptions ask for."""
        return tuple(dict.fromkeys(end.msg_type for end in self.publishers)) or self.msg_types


@dataclass(frozen=True, slots=True, kw_only=True)
class RosGraph:
    """All that a node has been told of by now."""

    nodes: tuple[str, ...] = ()
    """Full names; a name that two nodes have stands twice."""
    topics: tuple[TopicSeen, ...] = ()
    services: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Full name -> types (`pkg/srv/Name`)."""

    def topic(self, name: str) -> TopicSeen:
        """The topic of a name, without ends where nobody has it."""
        empty = TopicSeen(name=name, msg_types=())
        return next((topic for topic in self.topics if topic.name == name), empty)


def visible(graph: RosGraph) -> RosGraph:
    """The graph without what is hidden by ROS's custom: a part of the name begins with `_`."""
    return replace(
        graph,
        topics=tuple(topic for topic in graph.topics if "/_" not in topic.name),
        services={name: types for name, types in graph.services.items() if "/_" not in name},
    )


def parameter_nodes(graph: RosGraph) -> tuple[str, ...]:
    """Full names of the nodes that tell their parameters."""
    return tuple(
        name.removesuffix("/list_parameters")
        for name, types in graph.services.items()
        if PARAMETER_LIST in types
    )


def special_services(services: Mapping[str, tuple[str, ...]]) -> Mapping[str, tuple[str, ...]]:
    """The services without those that every node has, for parameters and its type definitions."""
    return {
        name: types
        for name, types in services.items()
        if not any(one.startswith(OF_EVERY_NODE) for one in types)
    }


def misfits(topic: TopicSeen) -> Iterator[str]:
    """Sentences on ends that do not hear each other: types that differ, QoS that asks too much."""
    for publisher in topic.publishers:
        for subscription in topic.subscriptions:
            who = f"{subscription.node or 'a node'} does not hear {publisher.node or 'a node'}: "
            if publisher.msg_type != subscription.msg_type:
                yield f"{who}{subscription.msg_type} is not {publisher.msg_type}"
            asks, offers = _request(subscription.qos), _request(publisher.qos)
            if asks.is_reliable and not offers.is_reliable:
                yield f"{who}it asks for `reliable`, and `best_effort` is offered"
            if asks.is_transient_local and not offers.is_transient_local:
                yield f"{who}it asks for `transient_local`, and `volatile` is offered"


def _request(qos: Offer) -> Request:
    return Request(
        is_reliable=qos.reliability == "reliable",
        is_transient_local=qos.durability == "transient_local",
    )
