"""The input of every check: the typed config, its topics, and facts about the machine."""

from dataclasses import dataclass

from obk_cli.config.environment import Environment, NodeFacts
from obk_cli.config.model import Node, Stack
from obk_cli.config.topology import Topology

__all__ = ["CheckContext", "code_of"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckContext:
    """A config to check."""

    stack: Stack
    topology: Topology
    environment: Environment


def code_of(node: Node, environment: Environment) -> NodeFacts | None:
    """What the source of a node shows; None if it cannot be read."""
    if node.pkg is None or node.executable is None:
        return None
    code = environment.read_node_code(node.pkg.value, node.executable.value)
    return code if isinstance(code, NodeFacts) else None
