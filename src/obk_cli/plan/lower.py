"""Lower a checked config to a plan. Cannot fail for a config that passed its checks."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import cast

from obelisk_spec.components import (
    CALLBACK_GROUPS_PARAMETER,
    DEFAULT_HISTORY_DEPTH,
    SETTING_SUFFIX,
    SETTINGS_PARAMETER,
    format_component_setting,
    format_setting,
)
from obelisk_spec.runtime_protocol import USE_SIM_TIME
from obelisk_spec.sim_block import DEFAULT_STEPS_PER_VIZ
from obelisk_spec.values import ParameterValue, is_none
from obk_cli.config.environment import Environment, ModelRead
from obk_cli.config.model import (
    COMPONENT_LISTS,
    FEEDBACK_TOPIC,
    JOYSTICK_EXECUTABLE,
    JOYSTICK_NODE,
    JOYSTICK_PACKAGE,
    JOYSTICK_TOPIC,
    Component,
    FileSearch,
    Joystick,
    Node,
    Sim,
    Spanned,
    Stack,
)
from obk_cli.config.topology import (
    Direction,
    TopicEndpoint,
    absolute_topic,
    joystick_endpoints,
    node_endpoints,
    publisher_of_timer,
)
from obk_cli.config.tree import plain_value
from obk_cli.diagnostics.source import Span
from obk_cli.plan.plan import (
    Endpoint,
    OnCrash,
    Origin,
    Plan,
    PlannedActuator,
    PlannedNode,
    PlannedRate,
    PlannedSensorGroup,
)

__all__ = ["lower_stack"]

DEFAULT_STACK_NAME = "obelisk"
_SIM_DEFAULTS = {"num_steps_per_viz": DEFAULT_STEPS_PER_VIZ}
_LEFT_OUT = ("non_obelisk", "callback_key")
_LEFT_OUT_OF_TIMERS = (*_LEFT_OUT, "history_depth")
_SETTING_ORDER = ("key", "ros_parameter", "topic", "msg_type", "history_depth", "timer_period_sec")


def lower_stack(stack: Stack, environment: Environment) -> Plan:
    """The plan of a stack, with its nodes in the order of the config."""
    joysticks = (_lower_joystick(joystick) for joystick in stack.joysticks if joystick.on)
    nodes = (*(_lower_node(node, environment) for node in stack.nodes), *joysticks)
    if stack.is_on_simulated_time:
        nodes = tuple(_on_simulated_time(node) for node in nodes)
    return Plan(
        name=stack.name.value if stack.name else DEFAULT_STACK_NAME,
        nodes=nodes,
        external_topics=tuple(t.name for t in stack.external_topics if t.may_be("published")),
    )


def _on_simulated_time(node: PlannedNode) -> PlannedNode:
    parameters = dict(node.parameters)
    parameters.setdefault(USE_SIM_TIME, True)
    return replace(node, parameters=parameters)


def _lower_node(node: Node, environment: Environment) -> PlannedNode:
    assert node.pkg is not None  # a required key: without it, the checks fail
    assert node.executable is not None
    endpoints = tuple(node_endpoints(node))
    models = (_path(s.model, s.model.written.value) for s in node.sims if s.model is not None)
    return PlannedNode(
        node=node.node_name,
        namespace=node.ros_namespace,
        section=node.section,
        device=node.device,
        package=node.pkg.value,
        executable=node.executable.value,
        origin=_origin(node.span),
        parameters=dict(_parameters(node)),
        remappings=tuple((remapping.old, remapping.new) for remapping in node.remappings),
        env=dict(node.env),
        log_level=node.log_level.value if node.log_level else None,
        publishes=_endpoints(endpoints, "publishes"),
        subscribes=_endpoints(endpoints, "subscribes"),
        model=next(models, None) if node.runs_simulation else None,
        sensor_groups=tuple(_sensor_groups(node)) if node.runs_simulation else (),
        actuators=tuple(_actuators(node, environment)) if node.runs_simulation else (),
        rates=tuple(_rates(node, endpoints)),
        on_crash=_on_crash(node),
    )


def _rates(node: Node, endpoints: tuple[TopicEndpoint, ...]) -> Iterator[PlannedRate]:
    sent = {end.component: end.topic for end in endpoints if end.direction == "publishes"}
    for timer in (c for c in node.used_components if c.kind == "timer"):
        if timer.identity and timer.timer_period_s is not None:
            topic = sent.get(publisher_of_timer(timer.identity))
            yield _rate(timer.identity, timer.timer_period_s, topic)
    if node.runs_simulation:
        for group in (group for sim in node.sims for group in sim.sensor_groups):
            topic = absolute_topic(group.topic.value, node)
            if topic and group.period_s is not None:
                yield _rate(topic, group.period_s, topic)


def _rate(name: str, period: Spanned[float], topic: str | None) -> PlannedRate:
    origin = _origin(period.span)
    return PlannedRate(name=name, period_s=period.value, origin=origin, topic=topic)


def _on_crash(node: Node) -> OnCrash | None:
    if node.on_crash is not None:
        return cast(OnCrash, node.on_crash.value)
    return "restart" if node.respawn is not None and node.respawn.value else None


def _sensor_groups(node: Node) -> Iterator[PlannedSensorGroup]:
    for sim in node.sims:
        blocks = sim.block.get("sensor_settings")
        for group, block in zip(
            sim.sensor_groups, blocks if isinstance(blocks, list) else (), strict=True
        ):
            pattern = (block.get("scan_config") or {}).get("pattern")
            yield PlannedSensorGroup(
                topic=absolute_topic(group.topic.value, node),
                kind=group.msg_type.value if group.msg_type else "",
                sensors=block.get("sensor_names") or {},
                rays=pattern.get("type") if isinstance(pattern, dict) else None,
            )


def _actuators(node: Node, environment: Environment) -> Iterator[PlannedActuator]:
    for sim in node.sims[:1]:
        if sim.model is not None and sim.model.found is not None:
            read = environment.read_model(sim.model.found)
            for actuator in read.facts.actuators if isinstance(read, ModelRead) else ():
                yield PlannedActuator(name=actuator.name, unit=actuator.unit)


def _endpoints(endpoints: tuple[TopicEndpoint, ...], direction: Direction) -> tuple[Endpoint, ...]:
    return tuple(
        Endpoint(topic=end.topic, msg_type=end.msg_type, rate_hz=end.rate_hz)
        for end in endpoints
        if end.direction == direction
    )


def _origin(span: Span) -> Origin:
    return Origin(path=span.path, line=span.line, column=span.column)


def _parameters(node: Node) -> Iterator[tuple[str, ParameterValue]]:
    """All ROS parameters of a node: the settings of its components, then the user's own."""
    for name, component in _component_parameters(node).items():
        yield name, format_component_setting(_own_setting(component))
    groups = _callback_groups(node)
    if groups:
        yield CALLBACK_GROUPS_PARAMETER, format_component_setting(groups)
    if node.used_components or node.callback_groups:
        yield SETTINGS_PARAMETER, format_setting(_all_settings(node))
    if node.params_path is not None:
        yield "params_path", _path(node.params_file, node.params_path.value)
    for sim in node.sims if node.runs_simulation else (s for s in node.sims if s.is_sound):
        yield sim.parameter, format_setting(_sim_setting(sim))
    if node.urdf is not None:
        yield "urdf_path", _path(node.urdf_file, node.urdf.value)
    for spanned, name in ((node.robot_topic, "robot_topic"), (node.tf_prefix, "tf_prefix")):
        if spanned is not None:
            yield name, spanned.value
    for parameter in node.params:
        yield parameter.name, parameter.value


def _component_parameters(node: Node) -> Mapping[str, Component]:
    """The components by ROS parameter, without those that have none and share their key."""
    taken = {c.ros_parameter.value for c in node.used_components if c.ros_parameter}
    names = [(_parameter_name(component), component) for component in node.used_components]
    by_key = Counter(name for name, component in names if component.ros_parameter is None)
    return {
        name: component
        for name, component in names
        if component.ros_parameter or (by_key[name] == 1 and name not in taken)
    }


def _parameter_name(component: Component) -> str:
    if component.ros_parameter is not None:
        return component.ros_parameter.value
    return f"{component.identity}{SETTING_SUFFIX}"


def _path(search: FileSearch | None, written: str) -> str:
    """The file if it was found, otherwise the path as written, which the node interprets."""
    return str(search.found) if search and search.found else written


def _setting(component: Component) -> Mapping[str, object]:
    """A component's entry as the runtime library reads it, whichever syntax the config uses.

    Both names and the default depth are filled in; empty settings are omitted.
    """
    written = plain_value(component.tree)
    assert isinstance(written, dict)  # a component's tree is a mapping
    filled = {"key": component.identity, "ros_parameter": _parameter_name(component), **written}
    if component.kind != "timer" and component.qos.history_depth is None:
        filled.setdefault("history_depth", DEFAULT_HISTORY_DEPTH)
    left_out = _LEFT_OUT_OF_TIMERS if component.kind == "timer" else _LEFT_OUT
    ordered = (*_SETTING_ORDER, *(key for key in filled if key not in _SETTING_ORDER))
    return {
        key: filled[key]
        for key in ordered
        if filled.get(key) is not None
        and key not in left_out
        and not (key == "callback_group" and is_none(filled[key]))
    }


def _own_setting(component: Component) -> Mapping[str, object]:
    """A component's entry without the name of its own ROS parameter."""
    own = {key: value for key, value in _setting(component).items() if key != "ros_parameter"}
    depth = own.get("history_depth")
    # Existing nodes convert its text with `int`, which rejects `10.0`.
    return {**own, "history_depth": int(depth)} if isinstance(depth, float) else own


def _callback_groups(node: Node) -> Mapping[str, object]:
    return {group.name.value: group.type.value for group in node.callback_groups if group.type}


def _all_settings(node: Node) -> Mapping[str, object]:
    settings: dict[str, object] = {
        key: [dict(_setting(c)) for c in node.used_components if c.kind == kind]
        for key, kind in COMPONENT_LISTS.items()
    }
    settings["callback_groups"] = _callback_groups(node)
    return {key: value for key, value in settings.items() if value}


def _sim_setting(sim: Sim) -> Mapping[str, object]:
    """The simulator's block with resolved paths; empty settings are omitted."""
    block = {
        key: value
        for key, value in sim.block.items()
        if value not in (None, _SIM_DEFAULTS.get(key)) and not is_none(value)
        if key != "ros_parameter"
    }
    if sim.model is not None:
        block["model_xml_path"] = _path(sim.model, sim.model.written.value)
    found = {file.written.value: _path(file, file.written.value) for file in sim.files}
    groups = block.get("sensor_settings")
    for group in groups if isinstance(groups, list) else ():
        if group.get("config_path") in found:
            group["config_path"] = found[group["config_path"]]
        if group.get("history_depth") == DEFAULT_HISTORY_DEPTH:
            del group["history_depth"]
    return block


def _lower_joystick(joystick: Joystick) -> PlannedNode:
    endpoints = tuple(joystick_endpoints(joystick))
    topics = ((JOYSTICK_TOPIC, joystick.pub_topic), (FEEDBACK_TOPIC, joystick.sub_topic))
    return PlannedNode(
        node=JOYSTICK_NODE,
        namespace="/",
        section="joystick",
        device=joystick.device,
        package=JOYSTICK_PACKAGE,
        executable=JOYSTICK_EXECUTABLE,
        origin=_origin(joystick.span),
        parameters={parameter.name: parameter.value for parameter in joystick.params},
        remappings=tuple((name, topic.value) for name, topic in topics if topic is not None),
        publishes=_endpoints(endpoints, "publishes"),
        subscribes=_endpoints(endpoints, "subscribes"),
        has_lifecycle=False,
    )
