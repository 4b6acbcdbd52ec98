"""What one process tells another of a ROS graph, as JSON: who is there, and parameters. Pure."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from obk_cli.launch.json_values import value_of
from obk_cli.looking.graph import Graph, TopicSeen
from obk_cli.looking.parameters import KINDS, Parameter

__all__ = [
    "GraphTold",
    "NodeEnds",
    "emit_graph",
    "emit_parameter",
    "parse_graph",
    "parse_parameter_told",
]

Types = Mapping[str, tuple[str, ...]]
"""Full name -> types."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeEnds:
    """What a node has."""

    publishes: Types
    subscribes: Types
    services: Types


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphTold:
    """A graph, and what each of its nodes has."""

    graph: Graph
    nodes: Mapping[str, NodeEnds]
    """By full name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Named:
    name: str
    types: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Node:
    node: str
    publishes: tuple[_Named, ...]
    subscribes: tuple[_Named, ...]
    services: tuple[_Named, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Told:
    nodes: tuple[str, ...]
    topics: tuple[TopicSeen, ...]
    services: tuple[_Named, ...]
    ends: tuple[_Node, ...]


def emit_graph(told: GraphTold) -> Mapping[str, Any]:
    """A graph as JSON's values."""
    ends = tuple(
        _Node(
            node=node,
            publishes=_named(one.publishes),
            subscribes=_named(one.subscribes),
            services=_named(one.services),
        )
        for node, one in told.nodes.items()
    )
    graph = told.graph
    services = _named(graph.services)
    return asdict(_Told(nodes=graph.nodes, topics=graph.topics, services=services, ends=ends))


def parse_graph(data: Mapping[str, Any]) -> GraphTold | None:
    """The graph that JSON's values tell of; None: they tell of none."""
    told = value_of(_Told, data)
    if told is None:
        return None
    return GraphTold(
        graph=Graph(nodes=told.nodes, topics=told.topics, services=_types(told.services)),
        nodes={
            one.node: NodeEnds(
                publishes=_types(one.publishes),
                subscribes=_types(one.subscribes),
                services=_types(one.services),
            )
            for one in told.ends
        },
    )


def emit_parameter(parameter: Parameter) -> Mapping[str, Any]:
    """A parameter as JSON's values."""
    return {"kind": parameter.kind, "value": parameter.value}


def parse_parameter_told(data: Any) -> Parameter | None:
    """The parameter that JSON's values tell of; None: they tell of none."""
    if not isinstance(data, dict) or data.get("kind") not in KINDS:
        return None
    value = data.get("value")
    return Parameter(kind=data["kind"], value=tuple(value) if isinstance(value, list) else value)


def _named(types: Types) -> tuple[_Named, ...]:
    return tuple(_Named(name=name, types=kinds) for name, kinds in types.items())


def _types(named: tuple[_Named, ...]) -> Types:
    return {one.name: one.types for one in named}
