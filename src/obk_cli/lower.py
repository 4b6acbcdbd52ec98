"""Checked config -> plan. Total: a config that passed its checks cannot fail here."""

from collections.abc import Iterator, Mapping

from obelisk_spec.components import SETTING_SUFFIX
from obelisk_spec.settings import format_setting
from obk_cli.config import (
    JOYSTICK_EXECUTABLE,
    JOYSTICK_PACKAGE,
    Component,
    FileSearch,
    Joystick,
    Node,
    ParameterValue,
    Sim,
    Stack,
)
from obk_cli.plan import Endpoint, Origin, Plan, Process
from obk_cli.source import Span
from obk_cli.tree import plain_value
from obk_cli.wiring import TopicEnd, node_ends, stack_ends

__all__ = ["DEFAULT_STACK_NAME", "lower_stack"]

DEFAULT_STACK_NAME = "obelisk"
_DEFAULT_SIM_PARAMETER = f"mujoco{SETTING_SUFFIX}"
_LISTS = (("publishers", "publisher"), ("subscribers", "subscriber"), ("timers", "timer"))
_LEFT_OUT = ("non_obelisk", "callback_key")


def lower_stack(stack: Stack) -> Plan:
    """The processes of a stack, in the order of the config."""
    joysticks = (_lower_joystick(joystick, stack) for joystick in stack.joysticks if joystick.on)
    return Plan(
        name=stack.name.value if stack.name else DEFAULT_STACK_NAME,
        processes=(*(_lower_node(node) for node in stack.nodes), *joysticks),
    )


def _lower_node(node: Node) -> Process:
    assert node.pkg is not None  # required keys: a config without them did not pass
    assert node.executable is not None
    ends = tuple(node_ends(node))
    return Process(
        node=node.node_name,
        namespace=node.ros_namespace,
        section=node.section,
        device=node.device,
        package=node.pkg.value,
        executable=node.executable.value,
        origin=_origin(node.span),
        parameters=dict(_parameters(node)),
        remappings=node.remappings,
        env=dict(node.env),
        log_level=node.log_level.value if node.log_level else None,
        publishes=_endpoints(ends, "publishes"),
        subscribes=_endpoints(ends, "subscribes"),
    )


def _endpoints(ends: tuple[TopicEnd, ...], direction: str) -> tuple[Endpoint, ...]:
    return tuple(
        Endpoint(topic=end.topic, msg_type=end.msg_type, rate_hz=end.rate_hz)
        for end in ends
        if end.direction == direction
    )


def _origin(span: Span) -> Origin:
    return Origin(path=span.path, line=span.line, column=span.column)


def _parameters(node: Node) -> Iterator[tuple[str, ParameterValue]]:
    """All ROS parameters of a node: the settings of its components, then the user's own."""
    for component in node.components:
        if component.ros_parameter is not None:
            yield component.ros_parameter.value, format_setting(_setting(component))
    if node.components or node.callback_groups:
        yield "obelisk_settings", format_setting(_all_settings(node))
    if node.params_path is not None:
        yield "params_path", _path(node.params_file, node.params_path.value)
    for sim in node.sims:
        name = sim.ros_parameter.value if sim.ros_parameter else _DEFAULT_SIM_PARAMETER
        yield name, format_setting(_sim_setting(sim))
    if node.urdf is not None:
        yield "urdf_path", _path(node.urdf_file, node.urdf.value)
    for spanned, name in ((node.robot_topic, "robot_topic"), (node.tf_prefix, "tf_prefix")):
        if spanned is not None:
            yield name, spanned.value
    for parameter in node.params:
        yield parameter.name, parameter.value


def _path(search: FileSearch | None, written: str) -> str:
    """The file if it was found, else the path as written: what it means is up to the node."""
    return str(search.found) if search and search.found else written


def _setting(component: Component) -> Mapping[str, object]:
    """A component's entry as the run time reads it: what was written, without what says nothing."""
    value = plain_value(component.tree)
    assert isinstance(value, dict)  # a component's tree is a mapping
    return {
        key: item
        for key, item in value.items()
        if item is not None
        and key not in _LEFT_OUT
        and not (key == "callback_group" and item == "None")
    }


def _all_settings(node: Node) -> Mapping[str, object]:
    settings: dict[str, object] = {
        key: [dict(_setting(c)) for c in node.components if c.kind == kind] for key, kind in _LISTS
    }
    settings["callback_groups"] = {
        group.name.value: group.type.value for group in node.callback_groups if group.type
    }
    return {key: value for key, value in settings.items() if value}


def _sim_setting(sim: Sim) -> Mapping[str, object]:
    """The block for the simulator, its paths resolved."""
    block = {key: value for key, value in sim.block.items() if value not in (None, "None")}
    if sim.model is not None:
        block["model_xml_path"] = _path(sim.model, sim.model.written.value)
    found = {file.written.value: _path(file, file.written.value) for file in sim.files}
    groups = block.get("sensor_settings")
    for group in groups if isinstance(groups, list) else ():
        if group.get("config_path") in found:
            group["config_path"] = found[group["config_path"]]
    return block


def _lower_joystick(joystick: Joystick, stack: Stack) -> Process:
    ends = tuple(end for end in stack_ends(stack) if end.section == "joystick")
    topics = (("joy", joystick.pub_topic), ("joy/set_feedback", joystick.sub_topic))
    return Process(
        node="obelisk_joystick",
        namespace="/",
        section="joystick",
        device=joystick.device,
        package=JOYSTICK_PACKAGE,
        executable=JOYSTICK_EXECUTABLE,
        origin=_origin(joystick.span),
        parameters={parameter.name: parameter.value for parameter in joystick.params},
        remappings=tuple((name, topic.value) for name, topic in topics if topic is not None),
        publishes=_endpoints(ends, "publishes"),
        subscribes=_endpoints(ends, "subscribes"),
    )
