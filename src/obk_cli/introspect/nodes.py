"""One node as the graph, its services and its launcher tell of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from obk_cli.errors import CommandFailedError
from obk_cli.introspect.graph_source import GraphSource, parameters_of
from obk_cli.introspect.target import GraphTarget
from obk_cli.runs.control_client import ask_status
from obk_cli.runs.protocol import NodeStatus

__all__ = ["NodeSeen", "known_nodes", "look_at_node"]

GET_STATE: Final = "lifecycle_msgs/srv/GetState"


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeSeen:
    """What is known of a node."""

    node: str
    """Full name."""
    publishes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Topic -> types."""
    subscribes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    services: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    parameters: int | None = None
    """How many; None: it does not tell."""
    state: str | None = None
    """Of its life cycle; None: it has none, or does not tell."""
    status: NodeStatus | None = None
    """What its launcher says, where that runs here."""
    run: str | None = None
    """The run folder's name."""


def known_nodes(target: GraphTarget) -> Mapping[str, NodeStatus]:
    """What the launchers of this host say of their nodes, by full name."""
    asked = (ask_status(folder) for folder in target.runs)
    return {node.node: node for status in asked if status for node in status.nodes}


def look_at_node(look: GraphSource, target: GraphTarget, node: str, timeout_s: float) -> NodeSeen:
    """Ask for all that is known of a node; one that does not answer is shown all the same.

    Args:
        look: the graph.
        target: whose launchers are asked.
        node: full name.
        timeout_s: for each answer of the node [s].
    """
    publishes, subscribes = look.topics_of(node)
    services = look.services_of(node)
    status = known_nodes(target).get(node)
    state = status.state if status else None
    if state is None and GET_STATE in services.get(f"{node}/get_state", ()):
        state = _state(look, node, timeout_s)
    runs = [folder.name for folder, run in target.runs.items() if node in run.all_nodes]
    return NodeSeen(
        node=node,
        publishes=publishes,
        subscribes=subscribes,
        services=services,
        parameters=_parameters(look, node, timeout_s),
        state=state,
        status=status,
        run=runs[0] if runs else None,
    )


def _state(look: GraphSource, node: str, timeout_s: float) -> str | None:
    from obk_cli.ros.participant import RosLook
    from obk_cli.ros.services import ServiceClient
    from obk_cli.ros.types import find_type

    if not isinstance(look, RosLook):  # a launcher has told all that it knows
        return None
    kind = find_type(GET_STATE)
    try:
        client = ServiceClient(look, f"{node}/get_state", kind)
        return str(client.call(kind.Request(), timeout_s, is_question=True).current_state.label)
    except CommandFailedError:
        return None


def _parameters(look: GraphSource, node: str, timeout_s: float) -> int | None:
    if f"{node}/list_parameters" not in look.service_types():
        return None
    try:
        return len(parameters_of(look, node, timeout_s).names())
    except CommandFailedError:
        return None
