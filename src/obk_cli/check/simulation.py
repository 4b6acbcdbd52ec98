"""OBK108, OBK3xx, OBK415: `sim` blocks and policies, their models, control messages, actuators."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final

from obelisk_spec.names import resolve_msg_type
from obelisk_spec.onnx_policy import TERMS, observation_size
from obelisk_spec.sim_block import parameter_fault
from obelisk_spec.sim_checks import SimFault, check_sim
from obelisk_spec.suggestions import did_you_mean, list_names, with_article, with_number
from obk_cli.check.context import CheckContext, code_of
from obk_cli.check.packages import no_such_package, where_it_is_not
from obk_cli.config.environment import (
    ControlLength,
    Environment,
    ModelFault,
    ModelRead,
    NodeFacts,
    PolicyFault,
    PolicyRead,
)
from obk_cli.config.fixes import respell
from obk_cli.config.model import (
    SIM_PARAMETER,
    Component,
    ConfigParameter,
    FileSearch,
    Node,
    Sim,
    Stack,
)
from obk_cli.config.topology import absolute_topic
from obk_cli.config.tree import Tree, TreeList, TreeMap, TreeScalar, plain_value
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found
from obk_cli.diagnostics.source import Span

__all__ = ["check_controls", "check_models", "check_policies", "check_sim_blocks"]


_NETWORK: Final = ".onnx"
_OBSERVATION: Final = "observation"
_JOINTS: Final = "joints"
_ACTION_JOINTS: Final = "action_joints"
_LISTS: Final = MappingProxyType(
    {
        "observation_scales": _OBSERVATION,
        "default_pose": _JOINTS,
        "action_scale": _ACTION_JOINTS,
        "kp": _ACTION_JOINTS,
        "kd": _ACTION_JOINTS,
    }
)
"""Parameter of a policy -> the parameter whose items it has values for."""


def check_sim_blocks(context: CheckContext) -> Iterator[Diagnostic]:
    """Check that no `sim` block replaces another, and that a simulator has one."""
    for node in context.stack.section("robot"):
        yield from _check_twice(node)
        is_off = node.is_simulated is not None and not node.is_simulated.value
        if not node.is_simulator:
            if node.sims and is_off:
                message = "`sim` has no effect because of `is_simulated: false`"
                yield found("OBK506", message, node.sims[0].span)
            continue
        if node.is_simulated is not None and is_off:
            yield found(
                "OBK321",
                f"`{node.node_name}` is a simulator, but `is_simulated: false` disables its "
                "`sim` block",
                node.is_simulated.span,
                help="remove this line, or use the executable for the hardware",
            )
        else:
            yield from _check_given(node)
            yield from _check_parameters(node)


def _check_twice(node: Node) -> Iterator[Diagnostic]:
    seen: dict[str, Sim] = {}
    for sim in node.used_sims:
        first = seen.setdefault(sim.parameter, sim)
        if first is not sim:
            yield found(
                "OBK108",
                f"two `sim` blocks of `{node.node_name}` set the parameter `{sim.parameter}`",
                sim.span,
                help="remove one, or set the `ros_parameter` declared for it in the code",
                related=(Related(message="the first one", span=first.span),),
            )


def _check_given(node: Node) -> Iterator[Diagnostic]:
    assert node.executable is not None  # it is the simulator's executable
    given = {*(sim.parameter for sim in node.sims), *(p.name for p in node.params)}
    if SIM_PARAMETER in given:
        return
    other = next((sim.ros_parameter for sim in node.sims if sim.ros_parameter), None)
    if other is None:
        yield found(
            "OBK321",
            f"`{node.node_name}` is a simulator without a `sim` block",
            node.executable.span,
            help="add `sim: {model_xml_path: ...}`",
        )
    else:
        yield found(
            "OBK321",
            f"the simulator reads its block from `{SIM_PARAMETER}`, but this one sets "
            f"`{other.value}`",
            other.span,
            help="remove `ros_parameter`",
        )


def _check_parameters(node: Node) -> Iterator[Diagnostic]:
    for parameter in node.params:
        fault = parameter_fault(parameter.name, parameter.value)
        if fault is not None:
            yield found("OBK415", fault, parameter.span)


def check_models(context: CheckContext) -> Iterator[Diagnostic]:
    """Check every valid `sim` block against its model, if the model can be read."""
    skipped: Span | None = None
    for node in context.stack.nodes:
        for sim in node.used_sims:
            if not sim.is_sound or sim.model is None:
                continue
            read = None
            if sim.model.found is None:
                yield _not_found(sim.model, sim, context.environment)
            else:
                read = context.environment.read_model(sim.model.found)
                skipped = skipped or (sim.model.written.span if read is None else None)
            if isinstance(read, ModelFault):
                yield _unreadable(read, sim.model, context.environment)
            in_block = tuple(_check_block(node, sim, read, context.environment))
            # A finding of the block may already report why MuJoCo stopped.
            has_error = any(finding.severity == "error" for finding in in_block)
            if isinstance(read, ModelRead) and read.fault is not None and not has_error:
                yield _unreadable(read.fault, sim.model, context.environment)
            yield from in_block
    if skipped is not None:
        message = "MuJoCo is not installed, so names are not checked against the model"
        help = "install the `mujoco` package to enable these checks"
        yield found("OBK300", message, skipped, help=help)


def _not_found(model: FileSearch, sim: Sim, environment: Environment) -> Diagnostic:
    if model.missing_package is not None and sim.robot_pkg is not None:
        return no_such_package(model, sim.robot_pkg, "model", environment)
    hint = (
        "" if sim.robot_pkg or model.near else "; set `robot_pkg` to the package that contains it"
    )
    message = f"model `{model.written.value}` was not found"
    return found("OBK301", message, model.written.span, help=where_it_is_not(model) + hint)


def _unreadable(fault: ModelFault, model: FileSearch, environment: Environment) -> Diagnostic:
    related: tuple[Related, ...] = ()
    if fault.line and model.found is not None:
        place = environment.model_line(model.found, fault.line)
        related = (Related(message="MuJoCo stopped here", span=place),)
    message = f"MuJoCo cannot read `{model.written.value}`: {fault.message}"
    return found("OBK302", message, model.written.span, related=related)


def _check_block(
    node: Node, sim: Sim, read: ModelRead | ModelFault | None, environment: Environment
) -> Iterator[Diagnostic]:
    parameters = {parameter.name: parameter.value for parameter in node.params}
    facts = read.facts if isinstance(read, ModelRead) else None
    block = plain_value(sim.checked or sim.tree)
    assert isinstance(block, dict)  # the value of a TreeMap is a dict
    for fault in check_sim(block, parameters, facts):
        yield _placed(fault, node, sim, environment)
    if isinstance(read, ModelRead) and read.missing_files and sim.model is not None:
        is_one = len(read.missing_files) == 1
        yield found(
            "OBK318",
            f"`{sim.model.written.value}` refers to "
            f"{'a missing file' if is_one else f'{len(read.missing_files)} missing files'}: "
            f"{list_names(read.missing_files, most=3)}",
            sim.model.written.span,
            help=f"the simulation cannot start without {'it' if is_one else 'them'}; the rest of "
            "the model was checked",
        )


def _placed(fault: SimFault, node: Node, sim: Sim, environment: Environment) -> Diagnostic:
    """Add the location in the config and in the model to a finding of the shared checks."""
    related: tuple[Related, ...] = ()
    if fault.element is not None and sim.model is not None and sim.model.found is not None:
        kind, name = fault.element
        place = environment.model_element(sim.model.found, kind, name)
        if place is not None:
            related = (Related(message="in the model", span=place),)
    span, written = _place_of(fault, node, sim)
    return found(
        fault.code,
        fault.message,
        span,
        help=fault.help,
        severity=fault.severity,
        related=related,
        fix=respell(span, written, fault.meant) if fault.meant and written else (),
    )


def _place_of(fault: SimFault, node: Node, sim: Sim) -> tuple[Span, str | None]:
    """Location of a finding, and the word there if a replacement may be suggested."""
    if fault.path[:1] == ("params",):
        name = ".".join(str(step) for step in fault.path[1:])
        parameter = next((p for p in node.params if p.name == name), None)
        return (parameter.span, str(parameter.value)) if parameter else (node.span, None)
    tree: Tree = sim.checked or sim.tree
    span, written = tree.span, None
    for step in fault.path:
        if isinstance(tree, TreeMap) and isinstance(step, str):
            entry = tree.get(step)
            if entry is None:
                return span, None
            is_key = fault.points_at == "key"
            is_taken = is_key and fault.meant is not None and tree.get(fault.meant) is not None
            tree = entry.value
            span = entry.key_span if is_key else tree.span
            written = None if is_taken else entry.key if is_key else _text(tree)
        elif isinstance(tree, TreeList) and isinstance(step, int):
            tree = tree.items[step]
            span, written = tree.span, _text(tree)
    return span, written


def _text(tree: Tree) -> str | None:
    return tree.value if isinstance(tree, TreeScalar) and isinstance(tree.value, str) else None


_Controllers = Mapping[str, Sequence[tuple[Node, NodeFacts]]]
"""Topic -> the controllers with readable code that publish commands only to it."""
_WITH_GAINS = "obelisk_control_msgs/msg/PDFeedForward"
_WITHOUT_ACTUATORS = (
    "obelisk_control_msgs/msg/VelocityCommand",
    "obelisk_control_msgs/msg/ExecutionFSM",
)


def check_controls(context: CheckContext) -> Iterator[Diagnostic]:
    """Check that the simulator can apply its commands: one value for each actuator."""
    reported: set[tuple[str, Span]] = set()
    controllers = _controllers(context.stack, context.environment)
    for robot in context.stack.section("robot"):
        if not robot.runs_simulation:
            continue
        for component in robot.components:
            if not component.takes_commands:
                continue
            if robot.is_simulator:
                yield from _check_message(component)
                yield from _check_gains(robot, component, controllers, context.environment)
            for place, fault in _check_lengths(robot, component, controllers, context.environment):
                if place not in reported:  # another robot may have the same controller
                    reported.add(place)
                    yield fault


def _check_message(component: Component) -> Iterator[Diagnostic]:
    if component.msg_type is None:
        return
    written = component.msg_type.value
    if resolve_msg_type(written) in _WITHOUT_ACTUATORS:
        yield found(
            "OBK315",
            f"the simulator cannot apply {with_article(written)}: the message has no field "
            "`u_mujoco` with actuator values",
            component.msg_type.span,
            help="use `PositionSetpoint` or `PDFeedForward`; a low-level controller can convert "
            "to one of them",
        )


def _controllers(stack: Stack, environment: Environment) -> _Controllers:
    controllers: defaultdict[str, list[tuple[Node, NodeFacts]]] = defaultdict(list)
    for node in stack.section("control"):
        code = code_of(node, environment)
        if code is not None:
            topics = {
                absolute_topic(component.topic.value, node)
                for component in node.components
                if component.kind == "publisher"
                and component.topic
                and _may_be_command(component, code)
            }
            # A message in the code may be for any of several topics.
            for topic in topics if len(topics) == 1 else ():
                controllers[topic].append((node, code))
    return controllers


def _may_be_command(publisher: Component, code: NodeFacts) -> bool:
    """Whether a publisher's messages are control messages, or of an unknown type."""
    if publisher.msg_type is not None:
        msg_type = resolve_msg_type(publisher.msg_type.value)
    else:
        registered = code.component_of(publisher)
        msg_type = registered.msg_type if registered is not None else None
    return msg_type is None or msg_type.startswith("obelisk_control_msgs/")


def _check_gains(
    robot: Node, control: Component, controllers: _Controllers, environment: Environment
) -> Iterator[Diagnostic]:
    """Check that each joint has one actuator, if the code of a controller mentions gains.

    A `PDFeedForward` without gains can be applied to any actuators.
    """
    written, topic = control.msg_type, control.topic
    if written is None or topic is None or resolve_msg_type(written.value) != _WITH_GAINS:
        return
    senders = controllers.get(absolute_topic(topic.value, robot), ())
    if all(code.words.isdisjoint(("kp", "kd")) for _, code in senders):
        return
    for model in (sim.model.found for sim in robot.used_sims if sim.model is not None):
        read = environment.read_model(model) if model is not None else None
        if model is None or not isinstance(read, ModelRead):
            continue
        for joint, count in Counter(one.joint for one in read.facts.actuators).items():
            if joint and count > 1:
                place = environment.model_element(model, "joint", joint)
                yield found(
                    "OBK315",
                    f"two actuators drive the joint `{joint}`, so the simulator rejects commands "
                    "with gains",
                    written.span,
                    severity="warning",
                    help="remove one of the actuators from the model, or send `u_mujoco` without "
                    "`kp` and `kd`",
                    related=(Related(message="in the model", span=place),) if place else (),
                )


def _check_lengths(
    robot: Node,
    control: Component,
    controllers: _Controllers,
    environment: Environment,
) -> Iterator[tuple[tuple[str, Span], Diagnostic]]:
    """The findings, each with the controller and the location in its code."""
    actuators = [
        len(read.facts.actuators)
        for sim in robot.sims
        if sim.model is not None and sim.model.found is not None
        if isinstance(read := environment.read_model(sim.model.found), ModelRead)
    ]
    if len(actuators) != 1 or control.topic is None:
        return
    for node, code in controllers.get(absolute_topic(control.topic.value, robot), ()):
        for length in code.control_lengths:
            if length.length != actuators[0]:
                fault = _wrong_length(length, node, code, robot, actuators[0])
                yield (node.full_name, length.span), fault


def _wrong_length(
    length: ControlLength, node: Node, code: NodeFacts, robot: Node, actuators: int
) -> Diagnostic:
    assert node.executable is not None  # the node's code was found through it
    (path, *_) = [sim.model_xml_path for sim in robot.sims if sim.model_xml_path]
    return found(
        "OBK317",
        f"class `{code.class_name}` writes {with_number(length.length, 'value')} into "
        f"`{length.field}`, but the model has {with_number(actuators, 'actuator')}",
        node.executable.span,
        help="the simulator rejects control messages of another length",
        related=(
            Related(message="in the code", span=length.span),
            Related(message="the model", span=path.span),
        ),
    )


def check_policies(context: CheckContext) -> Iterator[Diagnostic]:
    """Check every node that has `observation` and a network as `params_path`."""
    for node in context.stack.nodes:
        parameters = {parameter.name: parameter for parameter in node.params}
        observation, joints = parameters.get(_OBSERVATION), parameters.get(_JOINTS)
        path = node.params_file.found if node.params_file is not None else None
        if path is None or path.suffix != _NETWORK or observation is None or joints is None:
            continue
        actions = parameters.get(_ACTION_JOINTS, joints)
        unknown = tuple(_unknown_terms(observation))
        yield from unknown
        for parameter in dict.fromkeys((joints, actions)):
            yield from _unknown_joints(parameter, context)
        lengths = {_JOINTS: len(_words(joints)), _ACTION_JOINTS: len(_words(actions))}
        yield from _check_list_lengths(
            parameters, {**lengths, _OBSERVATION: len(_words(observation))}
        )
        if not unknown:
            yield from _check_network(path, node, observation, joints, actions, context)


def _check_list_lengths(
    parameters: Mapping[str, ConfigParameter], lengths: Mapping[str, int]
) -> Iterator[Diagnostic]:
    """Lists with an item for each joint, action or observed term."""
    for name, of in _LISTS.items():
        parameter, expected = parameters.get(name), lengths[of]
        if parameter is None or not isinstance(parameter.value, list | tuple):
            continue
        allowed = {expected} if of == _OBSERVATION else {1, expected}
        if (count := len(parameter.value)) not in allowed:
            yield found(
                "OBK322",
                f"`{name}` has {with_number(count, 'value')}, expected "
                f"{' or '.join(map(str, sorted(allowed)))}",
                parameter.span,
                help=f"write one value for each of `{of}`"
                + ("" if of == _OBSERVATION else ", or a single one for all"),
            )


def _words(parameter: ConfigParameter) -> Sequence[str]:
    value = parameter.value
    return [str(word) for word in value] if isinstance(value, list | tuple) else [str(value)]


def _unknown_terms(observation: ConfigParameter) -> Iterator[Diagnostic]:
    for term in _words(observation):
        if term not in TERMS:
            yield found(
                "OBK322",
                f"a policy cannot observe `{term}`",
                observation.span,
                help=did_you_mean(term, TERMS),
            )


def _unknown_joints(parameter: ConfigParameter, context: CheckContext) -> Iterator[Diagnostic]:
    """Report joints that the model lacks, if the stack has one readable model."""
    models = {
        sim.model.found
        for node in context.stack.nodes
        for sim in node.used_sims
        if sim.model is not None and sim.model.found is not None
    }
    read = context.environment.read_model(models.pop()) if len(models) == 1 else None
    if not isinstance(read, ModelRead):
        return
    for name in _words(parameter):
        if name not in read.facts.joints:
            yield found(
                "OBK322",
                f"the model has no joint `{name}`",
                parameter.span,
                help=did_you_mean(name, read.facts.joints),
            )


def _check_network(
    path: Path,
    node: Node,
    observation: ConfigParameter,
    joints: ConfigParameter,
    actions: ConfigParameter,
    context: CheckContext,
) -> Iterator[Diagnostic]:
    read = context.environment.read_policy(path)
    if isinstance(read, PolicyFault):
        assert node.params_path is not None  # the caller found the file
        yield found("OBK322", read.message, node.params_path.span)
    if not isinstance(read, PolicyRead):
        return
    joint_count, action_count = len(_words(joints)), len(_words(actions))
    size = observation_size(_words(observation), joints=joint_count, actions=action_count)
    if read.inputs is not None and read.inputs != size:
        yield found(
            "OBK322",
            f"`observation` has {with_number(size, 'value')} for "
            f"{with_number(joint_count, 'joint')}, "
            f"but the network `{path.name}` takes {read.inputs}",
            observation.span,
            help="write the terms and joints that the network was trained with",
        )
    if read.outputs is not None and read.outputs != action_count:
        yield found(
            "OBK322",
            f"the network `{path.name}` returns {with_number(read.outputs, 'value')} for "
            f"{with_number(action_count, 'joint')}",
            actions.span,
            help=f"name the joints that it commands as `{_ACTION_JOINTS}`",
        )
