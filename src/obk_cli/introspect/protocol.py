"""Queries to a launcher about the ROS graph, and its replies: JSON, checked against these types."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar, cast

import msgspec

from obelisk_spec.parameter_notes import ParameterNotes
from obk_cli.errors import CommandFailedError
from obk_cli.ros.graph import GraphSnapshot, TopicInfo
from obk_cli.ros.parameters import KINDS, NodeParameter, ParameterDescription
from obk_cli.runs.protocol import decode

__all__ = [
    "DescriptionsReply",
    "FailedReply",
    "GraphQuestion",
    "GraphReply",
    "KnownGraph",
    "NamesReply",
    "NodeEndpoints",
    "ParameterQuestion",
    "Question",
    "SetReply",
    "ValuesReply",
    "WireParameter",
    "decode_reply",
    "description_of",
    "graph_of",
    "graph_reply",
    "parameter_of",
    "wire_description",
    "wire_parameter",
]

T = TypeVar("T")

Types = Mapping[str, tuple[str, ...]]
"""Full name -> types."""
Scalar = bool | int | float | str


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeEndpoints:
    """The publishers, subscriptions and services of a node."""

    publishes: Types
    subscribes: Types
    services: Types


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownGraph:
    """A graph, and the endpoints of each of its nodes."""

    graph: GraphSnapshot
    nodes: Mapping[str, NodeEndpoints]
    """By full name."""


class WireParameter(msgspec.Struct, frozen=True, kw_only=True):
    """A parameter; `inf` and `nan`, which JSON lacks, are strings."""

    kind: str
    """One of `KINDS`."""
    value: Scalar | tuple[Scalar, ...] | None


class GraphQuestion(msgspec.Struct, frozen=True, kw_only=True, tag_field="about", tag="graph"):
    """Query for the whole graph."""


class ParameterQuestion(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    omit_defaults=True,
    tag_field="about",
    tag="parameters",
):
    """Query for a node's parameters, or request to set one."""

    node: str
    """Full name."""
    timeout_s: Annotated[float, msgspec.Meta(gt=0.0)]
    """Limit for each answer of the node [s]."""
    do: Literal["names", "values", "describe", "set"]
    names: tuple[str, ...] = ()
    """For `values` and `describe`."""
    name: str = ""
    """For `set`."""
    parameter: WireParameter | None = None
    """For `set`."""


Question = GraphQuestion | ParameterQuestion


class _Named(msgspec.Struct, frozen=True, kw_only=True):
    name: str
    types: tuple[str, ...]


class _Node(msgspec.Struct, frozen=True, kw_only=True):
    node: str
    publishes: tuple[_Named, ...]
    subscribes: tuple[_Named, ...]
    services: tuple[_Named, ...]


class GraphReply(msgspec.Struct, frozen=True, kw_only=True):
    """The whole graph."""

    nodes: tuple[str, ...]
    topics: tuple[TopicInfo, ...]
    services: tuple[_Named, ...]
    endpoints: tuple[_Node, ...]


class NamesReply(msgspec.Struct, frozen=True, kw_only=True):
    """The names of a node's parameters."""

    names: tuple[str, ...]


class ValuesReply(msgspec.Struct, frozen=True, kw_only=True):
    """The values of the requested parameters, in the same order."""

    values: tuple[WireParameter, ...]


class WireDescription(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A node's description of a parameter."""

    name: str
    kind: str
    """One of `KINDS`."""
    text: str = ""
    unit: str = ""
    least: float | None = None
    most: float | None = None
    choices: tuple[str, ...] = ()
    is_live: bool | None = None
    initial: Scalar | tuple[Scalar, ...] | None = None


class DescriptionsReply(msgspec.Struct, frozen=True, kw_only=True):
    """A node's descriptions of the requested parameters that it has."""

    descriptions: tuple[WireDescription, ...]


class SetReply(msgspec.Struct, frozen=True, kw_only=True):
    """A node's answer to a request to set a parameter; see `SetAnswer`."""

    successful: bool
    reason: str


class FailedReply(msgspec.Struct, frozen=True, kw_only=True):
    """Why a query failed."""

    failed: str
    help: str | None = None


def decode_reply(data: bytes | msgspec.Raw, kind: type[T]) -> T:
    """Decode a launcher's reply.

    Args:
        data: JSON.
        kind: the expected type of reply.

    Raises:
        CommandFailedError: the launcher reports a failure, or sends another type of reply.
    """
    try:
        return cast(T, decode(data, kind))
    except ValueError as error:
        fault = error
    try:
        failed = decode(data, FailedReply)
    except ValueError:
        raise CommandFailedError(
            f"the launcher of the stack sent an invalid answer: {fault}",
            help="it may run another version of obk: stop the stack and launch it with this one",
        ) from fault
    raise CommandFailedError(failed.failed, help=failed.help)


def graph_reply(known: KnownGraph) -> GraphReply:
    """Convert a graph to a reply."""
    graph = known.graph
    return GraphReply(
        nodes=graph.nodes,
        topics=graph.topics,
        services=_named(graph.services),
        endpoints=tuple(
            _Node(
                node=node,
                publishes=_named(endpoints.publishes),
                subscribes=_named(endpoints.subscribes),
                services=_named(endpoints.services),
            )
            for node, endpoints in known.nodes.items()
        ),
    )


def graph_of(reply: GraphReply) -> KnownGraph:
    """Convert a reply to a graph."""
    return KnownGraph(
        graph=GraphSnapshot(
            nodes=reply.nodes, topics=reply.topics, services=_types(reply.services)
        ),
        nodes={
            one.node: NodeEndpoints(
                publishes=_types(one.publishes),
                subscribes=_types(one.subscribes),
                services=_types(one.services),
            )
            for one in reply.endpoints
        },
    )


def wire_parameter(parameter: NodeParameter) -> WireParameter:
    """Convert a parameter to its wire format."""
    value: Any = parameter.value
    if parameter.kind == "double":
        value = _double(value)
    elif parameter.kind == "double_array":
        value = tuple(map(_double, value))
    return WireParameter(kind=parameter.kind, value=value)


def parameter_of(wire: WireParameter) -> NodeParameter:
    """Convert a parameter from its wire format.

    Raises:
        CommandFailedError: the type is unknown, or the value does not match it.
    """
    value: Any = wire.value
    try:
        if wire.kind not in KINDS or isinstance(value, tuple) is not wire.kind.endswith("_array"):
            raise ValueError
        if wire.kind == "double":
            value = float(value)
        elif wire.kind == "double_array":
            value = tuple(map(float, value))
    except (TypeError, ValueError):
        fault = f"the value of a parameter does not have the type {wire.kind}"
        raise CommandFailedError(fault) from None
    return NodeParameter(kind=wire.kind, value=value)


def wire_description(name: str, description: ParameterDescription) -> WireDescription:
    """Convert a description to its wire format."""
    notes = description.notes
    return WireDescription(
        name=name,
        kind=description.kind,
        text=description.text,
        unit=notes.unit,
        least=notes.least,
        most=notes.most,
        choices=notes.choices,
        is_live=notes.is_live,
        initial=notes.initial,
    )


def description_of(wire: WireDescription) -> ParameterDescription:
    """Convert a description from its wire format."""
    is_whole = wire.kind == "integer"
    least, most = (
        int(limit) if is_whole and limit is not None else limit for limit in (wire.least, wire.most)
    )
    initial: Any = wire.initial
    notes = ParameterNotes(
        unit=wire.unit,
        least=least,
        most=most,
        choices=wire.choices,
        is_live=wire.is_live,
        initial=initial,
    )
    return ParameterDescription(kind=wire.kind, notes=notes, text=wire.text)


def _double(value: float) -> float | str:
    return value if math.isfinite(value) else str(value)


def _named(types: Types) -> tuple[_Named, ...]:
    return tuple(_Named(name=name, types=kinds) for name, kinds in types.items())


def _types(named: tuple[_Named, ...]) -> Types:
    return {one.name: one.types for one in named}
