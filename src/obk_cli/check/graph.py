"""OBK201, OBK202: which nodes there are."""

from collections.abc import Iterator

from obk_cli.config import Node, Stack
from obk_cli.diagnostics import Diagnostic, Related, found
from obk_cli.source import Span
from obk_cli.surroundings import Surroundings

__all__ = ["check_node_names", "check_required_sections"]

_REQUIRED = (
    ("control", "a controller"),
    ("estimation", "an estimator"),
    ("robot", "a robot, real or simulated"),
)


def check_required_sections(stack: Stack, _: Surroundings) -> Iterator[Diagnostic]:
    """Each required section has a node on some device."""
    for section, what in _REQUIRED:
        if next(stack.section(section), None) is None:
            message = f"section `{section}` has no node, a stack needs {what}"
            yield found("OBK201", message, stack.span)


def check_node_names(stack: Stack, _: Surroundings) -> Iterator[Diagnostic]:
    """No two nodes have one full name."""
    seen: dict[str, Node] = {}
    for node in stack.nodes:
        first = seen.setdefault(node.full_name, node)
        if first is not node:
            yield found(
                "OBK202",
                f"two nodes are named `{node.full_name}`",
                _place(node),
                help="give one of them another `name` or `namespace`",
                related=(Related(message="the other one", span=_place(first)),),
            )


def _place(node: Node) -> Span:
    named = node.name or node.pkg
    return named.span if named else node.span
