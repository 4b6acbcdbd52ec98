"""Write a complete config for the nodes of a workspace and its robot model.

Pure: returns YAML text. MuJoCo is not used.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

from obelisk_spec.names import resolve_msg_type
from obelisk_spec.sensors import SENSOR_GROUPS
from obk_cli.config.environment import CodeComponent, NodeFacts
from obk_cli.config.model import COMPONENT_LISTS, ComponentKind
from obk_cli.scaffold.kinds import NODE_KINDS, SECTIONS
from obk_cli.scaffold.package_spec import MessageType
from obk_cli.scaffold.variables import sensor_topic

__all__ = ["Model", "StackNode", "StackSketch", "choose_nodes", "read_model_text", "stack_text"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelSensor:
    """A named sensor; `of` is the name of the object to which it is attached."""

    name: str
    type: str
    of: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """A model; `path` is as written in the config."""

    path: str
    sensors: tuple[ModelSensor, ...] = ()
    keyframes: tuple[str, ...] = ()
    actuators: int = 0

    def sensors_of(self, types: Collection[str], *, joints: bool) -> tuple[ModelSensor, ...]:
        """Sensors of these types: for joints all, otherwise one per type on the best object."""
        fitting = [sensor for sensor in self.sensors if sensor.type in types]
        if joints:
            return tuple(fitting)
        by_object: dict[str, dict[str, ModelSensor]] = {}
        for sensor in fitting:
            by_object.setdefault(sensor.of, {}).setdefault(sensor.type, sensor)
        return tuple(max(by_object.values(), key=len, default={}).values())


def read_model_text(text: str, path: str) -> Model | None:
    """Read a model; None if the text is not one."""
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError):
        return None
    if root.tag != "mujoco":
        return None
    sensors = (
        ModelSensor(
            name=element.get("name", ""),
            type=element.tag,
            of=element.get("site") or element.get("joint") or element.get("objname") or "",
        )
        for element in root.iterfind("sensor/*")
    )
    keys = (element.get("name", "") for element in root.iterfind("keyframe/key"))
    return Model(
        path=path,
        sensors=tuple(sensor for sensor in sensors if sensor.name),
        keyframes=tuple(key for key in keys if key),
        actuators=len(root.findall("actuator/*")),
    )


_MARKS = {
    "controller": "timer_ctrl_setting",
    "estimator": "timer_est_setting",
    "robot": "sub_ctrl_setting",
}
"""Kind of node -> what its base class registers."""
_ROLES = {
    "pub_ctrl_setting": ("ctrl", "PositionSetpoint"),
    "sub_ctrl_setting": ("ctrl", "PositionSetpoint"),
    "pub_est_setting": ("est", "EstimatedState"),
    "sub_est_setting": ("est", "EstimatedState"),
}
"""The topics of the base classes, and their types if the code does not determine them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StackNode:
    """An executable of the workspace, and its kind of node."""

    package: str
    executable: str
    code: NodeFacts

    @property
    def kind(self) -> str | None:
        """Its kind for `obk new`; None if it is none of them."""
        names = {component.ros_parameter for component in self.code.components}
        marked = (kind for kind, mark in _MARKS.items() if mark in names)
        has_publisher = any(c.kind == "publisher" for c in self.code.components)
        return next(marked, "sensor" if has_publisher else None)


@dataclass(frozen=True, slots=True, kw_only=True)
class StackSketch:
    """The content of a stack."""

    name: str
    nodes: tuple[StackNode, ...]
    """One controller, one estimator, at most one robot, any number of sensors."""
    model: Model | None
    """The model of the simulated robot; None if a node of the workspace is the robot."""


def choose_nodes(
    found: Iterable[StackNode], stand_ins: Iterable[StackNode]
) -> tuple[StackNode, ...]:
    """One controller, one estimator and perhaps a robot that match, and all sensors.

    Only one controller is used, because two would command the same robot. Without a robot node, the
    robot is simulated; stand-ins replace other missing nodes. If nothing matches, the first of each
    kind is used, and `obk validate` reports the mismatches.
    """
    by_kind: dict[str | None, list[StackNode]] = {}
    for node in found:
        by_kind.setdefault(node.kind, []).append(node)
    for node in stand_ins:
        by_kind.setdefault(node.kind, [node])
    sensors = tuple(by_kind.get("sensor", ()))
    robots = [*((robot,) for robot in by_kind.get("robot", ())), ()]
    choices = [
        (controller, estimator, *robot, *sensors)
        for robot in robots
        for controller in by_kind.get("controller", ())
        for estimator in by_kind.get("estimator", ())
    ]
    return next((nodes for nodes in choices if _fit(nodes)), choices[0] if choices else sensors)


def _fit(nodes: tuple[StackNode, ...]) -> bool:
    """Whether every message that a node subscribes to is published by another, or simulated."""
    stack = StackSketch(name="", nodes=nodes, model=None)
    sent = {topic for node in nodes for topic in _topics(stack, node, "publisher")}
    subscribed = {topic for node in nodes for topic in _topics(stack, node, "subscriber")}
    if any(node.kind == "robot" for node in nodes):
        return subscribed <= sent
    return all(message and message.name in SENSOR_GROUPS for _, message in subscribed - sent)


def _topics(
    stack: StackSketch, node: StackNode, kind: ComponentKind
) -> Iterator[tuple[str, MessageType | None]]:
    for component in _subscribed_types(node):
        if component.kind == kind:
            message = _message_of(component)
            yield _topic_of(stack, component, message), message


def stack_text(stack: StackSketch) -> str:
    """The config as text."""
    lines = [f"config: {stack.name}"]
    for kind in NODE_KINDS:
        nodes = [node for node in stack.nodes if node.kind == kind]
        is_simulated = kind == "robot" and stack.model is not None
        if nodes or is_simulated:
            lines += ["", f"{SECTIONS[kind]}:"]
        for node in nodes:
            lines += _node_lines(stack, node)
        if is_simulated:
            lines += _simulated_lines(stack)
    return "\n".join(lines) + "\n"


def _node_lines(stack: StackSketch, node: StackNode) -> Iterator[str]:
    yield f"  - pkg: {node.package}"
    yield f"    executable: {node.executable}"
    if node.kind == "robot":
        yield "    is_simulated: false"
    for title, kind in COMPONENT_LISTS.items():
        components = [c for c in _subscribed_types(node) if c.kind == kind]
        if components:
            yield f"    {title}:"
        for component in components:
            yield f"      - {': '.join(component.written)}"
            yield from (f"        {line}" for line in _settings(stack, node, component))


def _subscribed_types(node: StackNode) -> Iterator[CodeComponent]:
    return (c for c in node.code.components if not (c.is_optional or c.has_default) and c.name)


def _settings(stack: StackSketch, node: StackNode, component: CodeComponent) -> tuple[str, ...]:
    if component.kind == "timer":
        return (f"timer_period_sec: {0.01 if node.kind == 'sensor' else 0.002}",)
    message = _message_of(component)
    topic = f"topic: {_topic_of(stack, component, message)}"
    return (topic, f"msg_type: {message.spelling}") if message else (topic,)


def _topic_of(stack: StackSketch, component: CodeComponent, message: MessageType | None) -> str:
    topics = f"/{stack.name}"
    role = _ROLES.get(component.ros_parameter or "")
    if role is not None:
        return f"{topics}/{role[0]}"
    of_sensor = sensor_topic(message, topics) if message else f"{topics}/sensor"
    if of_sensor != f"{topics}/sensor":
        return of_sensor
    words = component.name.removesuffix("_setting")
    return f"{topics}/{words.removeprefix('pub_').removeprefix('sub_')}"


def _message_of(component: CodeComponent) -> MessageType | None:
    role = _ROLES.get(component.ros_parameter or "")
    written = component.msg_type or (role[1] if role else None)
    full = resolve_msg_type(written) if written else None
    if full is None:
        return None
    package, _, name = full.partition("/msg/")
    return MessageType(package=package, name=name)


def _simulated_lines(stack: StackSketch) -> Iterator[str]:
    assert stack.model is not None
    yield "  - pkg: obelisk_sim_py"
    yield "    executable: obelisk_mujoco_robot"
    yield "    is_simulated: true"
    if stack.model.keyframes:
        yield "    params:"
        yield f"      ic_keyframe: {stack.model.keyframes[0]}"
    yield "    subscribers:"
    yield "      - key: sub_ctrl"
    yield f"        topic: /{stack.name}/ctrl"
    yield f"        msg_type: {_control_type(stack).spelling}"
    yield "    sim:"
    yield f"      - model_xml_path: {stack.model.path}"
    groups = dict(_sensor_groups(stack, stack.model))
    for message in (message for message, sensors in groups.items() if not sensors):
        takes = " and ".join(f"`{kind}`" for kind in sorted(_takes(message)))
        yield f"        # {message.name}: {stack.model.path} names no sensors for it ({takes})."
    if any(groups.values()):
        yield "        sensor_settings:"
    for message, sensors in ((m, sensors) for m, sensors in groups.items() if sensors):
        yield f"          - topic: {sensor_topic(message, f'/{stack.name}')}"
        yield "            dt: 0.002"
        yield f"            msg_type: {message.name}"
        yield "            sensor_names:"
        yield from (f"              {sensor.name}: {sensor.type}" for sensor in sensors)


def _control_type(stack: StackSketch) -> MessageType:
    sent = (
        _message_of(component)
        for node in stack.nodes
        for component in node.code.components
        if component.ros_parameter == "pub_ctrl_setting"
    )
    default = MessageType(package="obelisk_control_msgs", name="PositionSetpoint")
    return next((message for message in sent if message), default)


def _sensor_groups(
    stack: StackSketch, model: Model
) -> Iterator[tuple[MessageType, Sequence[ModelSensor]]]:
    """Each sensor message that a node subscribes to, with the model's sensors for it."""
    subscribed = (
        _message_of(component)
        for node in stack.nodes
        for component in _subscribed_types(node)
        if component.kind == "subscriber"
    )
    for message in dict.fromkeys(message for message in subscribed if message):
        rule = SENSOR_GROUPS.get(message.name)
        if rule is None or not rule.reads_sensors or rule.published != message.full:
            continue
        yield message, model.sensors_of(_takes(message), joints=rule.objects == "scalar joint")


def _takes(message: MessageType) -> Collection[str]:
    # The old message has one field, which the stand-in estimator uses for positions.
    return {"jointpos"} if message.name == "JointEncoders" else SENSOR_GROUPS[message.name].takes
