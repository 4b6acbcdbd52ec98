"""Message types that only the code knows, put beside those that the config writes.

A stack in, the same stack out with `Component.code_type` filled in where a node's source says it.
"""

from dataclasses import replace

from obk_cli.config import Component, Node, Stack
from obk_cli.node_code import NodeCode
from obk_cli.surroundings import Surroundings

__all__ = ["resolve_types"]


def resolve_types(stack: Stack, surroundings: Surroundings) -> Stack:
    """The stack with the types of the code."""
    return replace(stack, nodes=tuple(_in_node(node, surroundings) for node in stack.nodes))


def _in_node(node: Node, surroundings: Surroundings) -> Node:
    if node.pkg is None or node.executable is None or not node.components:
        return node
    code = surroundings.read_node_code(node.pkg.value, node.executable.value)
    if not isinstance(code, NodeCode):
        return node
    return replace(node, components=tuple(_in_component(c, code) for c in node.components))


def _in_component(component: Component, code: NodeCode) -> Component:
    registered = code.component_of(component)
    if registered is None or registered.msg_type is None:
        return component
    return replace(component, code_type=registered.msg_type)
