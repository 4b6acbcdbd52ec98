"""The variables of templates, and a new node's entry in the config.

Pure: returns values and YAML for a spec.
"""

from dataclasses import dataclass

from obk_cli.scaffold.kinds import NODE_KINDS, SECTIONS
from obk_cli.scaffold.message_code import (
    LINE_LENGTH,
    MessageCode,
    control_code,
    cpp_control,
    cpp_estimate,
    cpp_header,
    cpp_type,
    estimate_code,
    import_block,
    joints_code,
    message_imports,
    names_code,
    position_field,
    reading_code,
)
from obk_cli.scaffold.package_spec import MessageType, PackageSpec

__all__ = [
    "TOPICS_TO_FILL_IN",
    "TestedStack",
    "config_snippet",
    "dependencies",
    "entry_point",
    "sensor_topic",
    "template_variables",
]

TOPICS_TO_FILL_IN = "/STACK"
"""Placeholder for the topic prefix of an unknown stack."""

_SENSOR_TOPICS = {
    "obelisk_sensor_msgs/msg/JointEncoders": "joint_encoders",
    "obelisk_sensor_msgs/msg/ObkJointEncoders": "obk_joint_encoders",
    "obelisk_sensor_msgs/msg/ObkImu": "imu",
    "obelisk_sensor_msgs/msg/ObkFramePose": "framepose",
}
_PERIOD_S = {"controller": 0.001, "estimator": 0.001, "robot": 0.001, "sensor": 0.01}


@dataclass(frozen=True, slots=True)
class Wire:
    """A publisher or subscriber of a node: its key, its topic and its message type."""

    key: str
    topic: str
    message: MessageType


@dataclass(frozen=True, slots=True, kw_only=True)
class TestedStack:
    """The stack that a new node joins, as named in the node's test."""

    config: str
    """Path, relative to the folder of the test."""
    topic: str
    """A topic that the node publishes."""


def sensor_topic(message: MessageType, topics: str) -> str:
    """The topic of a kind of sensor message."""
    return f"{topics}/{_SENSOR_TOPICS.get(message.full, 'sensor')}"


def wires_of(spec: PackageSpec, topics: str) -> dict[str, tuple[Wire, ...]]:
    """The `publishers` and `subscribers` of a kind of node."""
    ctrl = (f"{topics}/ctrl", spec.ctrl)
    est = (f"{topics}/est", spec.est)
    sensor = (sensor_topic(spec.sensor, topics), spec.sensor)
    publishes = {"controller": ("pub_ctrl", *ctrl), "estimator": ("pub_est", *est)}
    subscribes = {
        "controller": ("sub_est", *est),
        "estimator": ("sub_sensor", *sensor),
        "robot": ("sub_ctrl", *ctrl),
    }
    publisher = publishes.get(spec.kind, ("pub_sensor", *sensor))
    subscriber = subscribes.get(spec.kind)
    return {
        "publishers": (Wire(*publisher),),
        "subscribers": (Wire(*subscriber),) if subscriber else (),
    }


def config_snippet(spec: PackageSpec, topics: str = TOPICS_TO_FILL_IN) -> str:
    """The node as one entry of a section's list."""
    timers = {"controller": "timer_ctrl", "estimator": "timer_est"}
    return "\n".join(
        [
            f"- pkg: {spec.package}",
            f"  executable: {spec.node}",
            *(("  is_simulated: false",) if spec.kind == "robot" else ()),
            *_parameter_lines(spec),
            *(
                line
                for name, wires in wires_of(spec, topics).items()
                if wires
                for line in (f"  {name}:", *(line for wire in wires for line in _lines(wire)))
            ),
            "  timers:",
            f"    - key: {timers.get(spec.kind, 'timer_sensor')}",
            f"      timer_period_sec: {_PERIOD_S[spec.kind]}",
        ]
    )


def _parameter_lines(spec: PackageSpec) -> tuple[str, ...]:
    """The parameters that the generated node declares."""
    if spec.kind == "controller" and control_code(spec.ctrl).uses_math:
        return ("  params:", "    amplitude: 1.0")
    return ()


def _lines(wire: Wire) -> tuple[str, ...]:
    return (
        f"    - key: {wire.key}",
        f"      topic: {wire.topic}",
        f"      msg_type: {wire.message.spelling}",
    )


_BASES = {
    "controller": ("obelisk_py.core.control", "ObeliskController"),
    "estimator": ("obelisk_py.core.estimation", "ObeliskEstimator"),
    "robot": ("obelisk_py.core.robot", "ObeliskRobot"),
    "sensor": ("obelisk_py.core.sensing", "ObeliskSensor"),
}
_LIFECYCLE = "rclpy.lifecycle"
_OFFSET = "self.offset + "
"""Prefix of simulated readings of a sensor without a device."""
_POSITIONS = f"[{_OFFSET}math.sin(self.t)]"
_JOINT_POSITIONS = "[self.positions[joint] for joint in JOINTS]"


def template_variables(
    spec: PackageSpec, topics: str = TOPICS_TO_FILL_IN, stack: TestedStack | None = None
) -> dict[str, object]:
    """The variables of a node's package, or of a message package."""
    common: dict[str, object] = {
        "kind": spec.kind,
        "package": spec.package,
        "node": spec.node,
        "with_service": spec.with_service,
        "ctrl": spec.ctrl,
        "est": spec.est,
        "sensor": spec.sensor,
        "tested_stack": stack,
    }
    if spec.kind not in NODE_KINDS:
        return common
    return common | _node_variables(spec, topics) | _import_variables(spec)


def dependencies(spec: PackageSpec) -> tuple[str, ...]:
    """The ROS packages that the node needs, sorted."""
    client = {"rclpy"} if spec.language == "py" else {"rclcpp"}
    if spec.language == "cpp" and _has_parameter(spec):
        client.add("rcl_interfaces")
    return tuple(sorted({*client, *(message.package for message in spec.messages)}))


def entry_point(spec: PackageSpec) -> str:
    """The console script that runs the node."""
    return f"{spec.node} = {spec.package}.{spec.node}:main"


_TEST_TOPICS = "/test"
"""Prefix of a node's topics in its own tests."""


def _test_entry(spec: PackageSpec) -> str:
    """The node as the only one of its tests' config; tests never open hardware."""
    snippet = config_snippet(spec, _TEST_TOPICS)
    simulated = snippet.replace("  is_simulated: false", "  is_simulated: true")
    return "\n".join(f"  {line}" for line in simulated.splitlines())


def _node_variables(spec: PackageSpec, topics: str) -> dict[str, object]:
    if spec.kind == "robot":
        reading = reading_code(spec.sensor, _JOINT_POSITIONS, names="list(JOINTS)")
    else:
        reading = reading_code(spec.sensor, _POSITIONS, _OFFSET)
    return {
        "class_name": spec.class_name,
        "description": f"The {spec.node} {spec.kind} for Obelisk.",
        "entry_point": entry_point(spec),
        "entry_point_noqa": _noqa(entry_point(spec)),
        "section": SECTIONS[spec.kind],
        "config_snippet": config_snippet(spec, topics),
        "test_entry": _test_entry(spec),
        "test_inputs": ", ".join(
            wire.topic for wire in wires_of(spec, _TEST_TOPICS)["subscribers"]
        ),
        "test_sensor_topic": sensor_topic(spec.sensor, _TEST_TOPICS),
        "control": control_code(spec.ctrl, spec.controls),
        "estimate": estimate_code(spec.est, spec.sensor),
        "reading": reading,
        **_joint_variables(spec, reading),
        "dependencies": dependencies(spec),
        "release": spec.release,
        "cpp_types": {
            "ctrl": cpp_type(spec.ctrl),
            "est": cpp_type(spec.est),
            "sensor": cpp_type(spec.sensor),
        },
        "cpp_headers": _cpp_headers(spec),
        "cpp_control": cpp_control(spec.ctrl, spec.controls),
        "cpp_estimate": cpp_estimate(spec.est, spec.sensor),
    }


def _joint_variables(spec: PackageSpec, reading: MessageCode) -> dict[str, object]:
    """`joints` and `driven` as code, empty if unused, and the commanded positions, if any."""
    joints = spec.joints
    has_joints = any(_JOINT_POSITIONS in line for line in reading.statements)
    field = position_field(spec.ctrl) if has_joints else ""
    follows = "" if field == "u_mujoco" and not (joints.are_servos and joints.driven) else field
    is_ordered = joints.driven in ((), tuple(joints.start))
    return {
        "joints": joints_code(joints.start) if has_joints else "",
        "driven": "" if is_ordered or not follows else names_code(joints.driven),
        "follows": follows,
        "test_command": f"u_mujoco=[0.0] * {len(joints.driven)}" if follows == "u_mujoco" else "",
    }


def _cpp_headers(spec: PackageSpec) -> tuple[str, ...]:
    descriptor = (MessageType(package="rcl_interfaces", name="ParameterDescriptor"),)
    messages = (*spec.messages, *(descriptor if _has_parameter(spec) else ()))
    return tuple(sorted({cpp_header(message) for message in messages}))


def _import_variables(spec: PackageSpec) -> dict[str, object]:
    messages = message_imports(spec.messages)
    node = (
        *messages,
        _BASES[spec.kind],
        ("obelisk_py.core.utils.ros", "spin_obelisk"),
        (_LIFECYCLE, "LifecycleState"),
        (_LIFECYCLE, "TransitionCallbackReturn"),
    )
    if spec.kind == "sensor":
        node = tuple(name for name in node if name[0] != _LIFECYCLE)
    if _has_parameter(spec):
        node = (*node, ("obelisk_py.core.parameter", "Parameter"))
    test = (*messages, ("obk_testing.plugin", "StartStack"))
    if spec.kind == "robot":
        test = (*test, ("obelisk_py.core.utils.ros", "run_transitions"))
    return {"node_imports": import_block(node), "test_imports": import_block(test)}


def _has_parameter(spec: PackageSpec) -> bool:
    """Whether the generated node declares a `Parameter`, because it has something to tune."""
    match spec.kind:
        case "controller":
            return control_code(spec.ctrl).uses_math
        case "robot":
            return False
        case "sensor":
            return bool(reading_code(spec.sensor, _POSITIONS).unit)
    return True


def _noqa(script: str) -> str:
    """A `noqa` for strings in setup.py, which cannot be wrapped and may be too long."""
    indent_and_quotes = 15
    return "  # noqa: E501" if len(script) + indent_and_quotes > LINE_LENGTH else ""
