"""OBK605, OBK611 to OBK613: nodes and settings that lockstep runs cannot reproduce.

`source_analysis.hazards` finds what the source of a node shows (OBK601 to OBK609).
"""

from collections.abc import Iterator

from obk_cli.check.context import CheckContext
from obk_cli.config.environment import Command
from obk_cli.config.model import Node
from obk_cli.diagnostics.diagnostic import Diagnostic, found

__all__ = ["check_lockstep"]

_OVERRIDES = "qos_overrides."
_NOT_SIMULATED = ("deadline", "lifespan", "liveliness", "liveliness_lease_duration")
"""QoS policies that the middleware measures in real time."""


def check_lockstep(context: CheckContext) -> Iterator[Diagnostic]:
    """Report nodes that cannot be part of a lockstep run, and hazards of the others."""
    for node in context.stack.nodes:
        if node.is_simulated is not None and not node.is_simulated.value:
            yield found(
                "OBK613",
                f"`{node.node_name}` is hardware, which is not started in lockstep runs",
                node.is_simulated.entry_span,
                help="test a variant of this config with a simulated robot",
            )
        elif node.pkg is not None and node.executable is not None:
            yield from _check_executable(context, node, (node.pkg.value, node.executable.value))
    for joystick in context.stack.joysticks:
        if joystick.on:
            yield found(
                "OBK612",
                f"`{joystick.full_name}` has no lifecycle, so it is not part of lockstep runs",
                joystick.span,
                help="publish its topic from the test",
            )


def _check_executable(
    context: CheckContext, node: Node, names: tuple[str, str]
) -> Iterator[Diagnostic]:
    assert node.executable is not None
    command = context.environment.find_executable(*names)
    is_cpp = context.environment.is_cpp(*names)
    if is_cpp or (isinstance(command, Command) and not command.is_of_this_python):
        what = "is written in C++" if is_cpp else "does not run in this Python interpreter"
        yield found(
            "OBK611",
            (
                f"`{node.executable.value}` {what}, so `{node.node_name}` is not part of lockstep "
                "runs"
            ),
            node.executable.span,
            help="omit the node in the test, or publish its topics from the test",
        )
        return
    for parameter in node.params:
        policy = parameter.name.rpartition(".")[2]
        if parameter.name.startswith(_OVERRIDES) and policy in _NOT_SIMULATED:
            yield found(
                "OBK605",
                f"lockstep runs do not simulate the QoS policy `{policy}`",
                parameter.key_span or parameter.span,
            )
    yield from context.environment.read_hazards(*names)
