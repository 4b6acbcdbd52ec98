"""OBK315, OBK317: control messages against the simulator and the model's actuators."""

from collections.abc import Iterator

from obelisk_spec.articles import with_article, with_number
from obelisk_spec.messages import resolve_msg_type
from obk_cli.check.context import CheckContext
from obk_cli.config import Component, Node, Stack
from obk_cli.diagnostics import Diagnostic, Related, found
from obk_cli.node_code import ControlLength, NodeCode
from obk_cli.source import Span
from obk_cli.surroundings import ModelRead, Surroundings
from obk_cli.wiring import absolute_topic

__all__ = ["check_controls"]

_WITHOUT_ACTUATORS = (
    "obelisk_control_msgs/msg/VelocityCommand",
    "obelisk_control_msgs/msg/ExecutionFSM",
)


def check_controls(context: CheckContext) -> Iterator[Diagnostic]:
    """The simulator can apply the message that it obeys, and it has a value for each actuator."""
    told: set[tuple[str, Span]] = set()
    for robot in context.stack.section("robot"):
        if not robot.runs_simulation:
            continue
        for component in robot.components:
            if not component.takes_commands:
                continue
            if robot.is_simulator:
                yield from _check_message(component)
            for place, fault in _check_lengths(
                context.stack, robot, component, context.surroundings
            ):
                if place not in told:  # by another robot that obeys the same controller
                    told.add(place)
                    yield fault


def _check_message(component: Component) -> Iterator[Diagnostic]:
    if component.msg_type is None:
        return
    written = component.msg_type.value
    if resolve_msg_type(written) in _WITHOUT_ACTUATORS:
        yield found(
            "OBK315",
            f"the simulator cannot apply {with_article(written)}: it has no `u_mujoco`, "
            "the values for the actuators",
            component.msg_type.span,
            help="it takes `PositionSetpoint` and `PDFeedForward`; a low-level controller can "
            "turn one into the other",
        )


def _check_lengths(
    stack: Stack, robot: Node, obeyed: Component, surroundings: Surroundings
) -> Iterator[tuple[tuple[str, Span], Diagnostic]]:
    """The findings, each with the controller and the place in its code."""
    actuators = [
        read.facts.actuators
        for sim in robot.sims
        if sim.model is not None and sim.model.found is not None
        if isinstance(read := surroundings.read_model(sim.model.found), ModelRead)
    ]
    if len(actuators) != 1 or obeyed.topic is None:
        return
    topic = absolute_topic(obeyed.topic.value, robot)
    for node in stack.section("control"):
        if node.pkg is None or node.executable is None:
            continue
        published = [
            c.topic
            for c in node.components
            if c.kind == "publisher" and c.topic and absolute_topic(c.topic.value, node) == topic
        ]
        code = surroundings.read_node_code(node.pkg.value, node.executable.value)
        if published and isinstance(code, NodeCode):
            for length in code.control_lengths:
                if length.length != actuators[0]:
                    fault = _wrong_length(length, node, code, robot, actuators[0])
                    yield (node.full_name, length.span), fault


def _wrong_length(
    length: ControlLength, node: Node, code: NodeCode, robot: Node, actuators: int
) -> Diagnostic:
    assert node.executable is not None  # its code was read
    (path, *_) = [sim.model_xml_path for sim in robot.sims if sim.model_xml_path]
    return found(
        "OBK317",
        f"class `{code.class_name}` writes {with_number(length.length, 'value')} into "
        f"`{length.field}`, the model has {with_number(actuators, 'actuator')}",
        node.executable.span,
        help="the simulator refuses a control message of another length",
        related=(
            Related(message="in the code", span=length.span),
            Related(message="the model", span=path.span),
        ),
    )
