"""OBK201, OBK202: which nodes there are."""

from collections.abc import Iterator

from obk_cli.check.context import CheckContext
from obk_cli.config import Stack
from obk_cli.diagnostics import Diagnostic, Related, found
from obk_cli.source import Span

__all__ = ["check_node_names", "check_required_sections"]

_REQUIRED = (
    ("control", "a controller"),
    ("estimation", "an estimator"),
    ("robot", "a robot, real or simulated"),
)


def check_required_sections(context: CheckContext) -> Iterator[Diagnostic]:
    """Each required section has a node on some device."""
    for section, what in _REQUIRED:
        if next(context.stack.section(section), None) is None:
            message = f"section `{section}` has no node, a stack needs {what}"
            yield found("OBK201", message, context.stack.span)


def check_node_names(context: CheckContext) -> Iterator[Diagnostic]:
    """No two nodes have one full name."""
    seen: dict[str, Span] = {}
    for name, place, help in _named(context.stack):
        if name not in seen:
            seen[name] = place
            continue
        yield found(
            "OBK202",
            f"two nodes are named `{name}`",
            place,
            help=help,
            related=(Related(message="the other one", span=seen[name]),),
        )


def _named(stack: Stack) -> Iterator[tuple[str, Span, str]]:
    """The full name of each node, its place, and what would give it another."""
    for node in stack.nodes:
        named = node.name or node.pkg
        place = named.span if named else node.span
        yield node.full_name, place, "give one of them another `name` or `namespace`"
    for joystick in stack.joysticks:
        if joystick.on:
            yield joystick.full_name, joystick.span, "switch one of the two off: `on: false`"
