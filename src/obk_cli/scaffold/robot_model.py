"""The parts of a workspace that depend on a robot's model: sensor groups and a pose controller.

Pure: returns sensor groups, MJCF text and template values for the facts about a model.
"""

import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from obelisk_spec.model import ModelFacts, SensorFact
from obelisk_spec.sensors import SENSOR_GROUPS
from obelisk_spec.suggestions import list_names, with_number
from obelisk_spec.yaml_core import core_scalar
from obk_cli.scaffold.message_code import LINE_LENGTH, quoted
from obk_cli.scaffold.package_spec import RobotJoints

__all__ = [
    "HeldActuator",
    "Hold",
    "RobotModel",
    "describe_robot",
    "model_variables",
    "robot_joints",
    "sensor_groups",
    "supplement",
    "unused_sensors",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldActuator:
    """An actuator, and how it holds its joint.

    control = setpoint + kp * (pose - position) - kd * velocity.
    """

    joint: str
    """The hinge or slide that it drives; empty if it drives something else."""
    is_slide: bool = False
    pose: float = 0.0
    """Position of the joint [rad or m]."""
    setpoint: float = 0.0
    kp: float = 0.0
    kd: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold:
    """A control law that holds a model in the pose of a keyframe, tested in a simulation."""

    keyframe: str
    """Empty: the initial state of a model without keyframes."""
    actuators: tuple[HeldActuator, ...]
    """In the order of the model."""
    is_torque: bool
    """Whether each actuator is the only motor of a joint; the simulator then closes the loops."""
    drift: float
    """Largest distance of a driven joint from its pose in the simulation [rad or m]."""

    @property
    def has_feedback(self) -> bool:
        """Whether the controller must close a loop; servos do so in the model."""
        return not self.is_torque and any(actuator.kp for actuator in self.actuators)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelSensors:
    """A sensor group of the config; `topic` is the last part of its name."""

    topic: str
    message: str
    sensors: Mapping[str, str]
    """Sensor -> type."""
    ignored: tuple[str, ...] = ()
    """Rules to silence, which would report a missing sensor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotModel:
    """What the files of a workspace need to know about its model."""

    path: str
    """Relative to the workspace."""
    period_s: float
    """Period of sensors, estimator and controller [s]."""
    hold: Hold
    groups: tuple[ModelSensors, ...]
    """The group of the joints first."""
    added: str = ""
    """What `path` adds to the given model, as words."""
    unused: tuple[str, ...] = ()
    """Sentences about sensors that are in no group."""


def scalar_joints(facts: ModelFacts) -> tuple[str, ...]:
    """The named joints that a `jointpos` sensor can measure."""
    return tuple(name for name, kind in facts.joints.items() if kind in ("hinge", "slide"))


def sensor_groups(facts: ModelFacts, driven: Iterable[str]) -> tuple[ModelSensors, ...]:
    """The groups that publish the sensors of a model.

    Args:
        facts: the model, with the encoders of all its joints.
        driven: joints that come first among the encoders.
    """
    order = tuple(dict.fromkeys((*(joint for joint in driven if joint), *scalar_joints(facts))))
    encoders = {
        sensor.name: sensor.type
        for kind in ("jointpos", "jointvel")
        for joint in order
        for sensor in _of_joint(facts, joint, kind)
    }
    return (
        ModelSensors(topic="encoders", message="ObkJointEncoders", sensors=encoders),
        *_at_objects(facts, "ObkImu", "imu", needed=("accelerometer", "gyro")),
        *_at_objects(facts, "ObkFramePose", "pose", needed=("framepos", "framequat")),
        *_forces(facts),
    )


_NEEDED = {
    "accelerometer": "an `ObkImu` needs an accelerometer and a gyro at one site",
    "gyro": "an `ObkImu` needs an accelerometer and a gyro at one site",
    "framepos": "an `ObkFramePose` needs a `framepos` and a `framequat` of one object",
    "framequat": "an `ObkFramePose` needs a `framepos` and a `framequat` of one object",
}
"""Sensor type -> why a sensor of this type may be in no group."""


def unused_sensors(facts: ModelFacts, groups: Iterable[ModelSensors]) -> tuple[str, ...]:
    """Sentences about the named sensors of a model that are in no group, and why."""
    names = {name for group in groups for name in group.sensors}
    used = {(s.type, s.object_type, s.object_name) for s in map(facts.sensors.get, names) if s}
    by_reason: dict[str, list[str]] = {}
    for sensor in (s for s in facts.sensors.values() if s.name not in names):
        is_second = (sensor.type, sensor.object_type, sensor.object_name) in used
        without_group = _NEEDED.get(sensor.type, "no sensor group is created for their type")
        reason = "another sensor measures the same" if is_second else without_group
        by_reason.setdefault(reason, []).append(sensor.name)
    return tuple(
        f"not in the config: {list_names(sensors)}; {reason}"
        for reason, sensors in by_reason.items()
    )


def robot_joints(
    facts: ModelFacts, keyframe: str, sensors: Iterable[str] = ()
) -> RobotJoints | None:
    """The joints of a robot that replaces a simulated one; None if no joint has a name.

    Args:
        facts: the model.
        keyframe: its initial state; empty or unknown for that of a model without keyframes.
        sensors: the sensors of the simulated robot's encoders, in their order.
    """
    driven = tuple(actuator.joint for actuator in facts.actuators)
    measured = (facts.sensors.get(name) for name in sensors)
    positions = tuple(s.object_name for s in measured if s is not None and s.type == "jointpos")
    order = positions or (*driven, *scalar_joints(facts))
    pose = facts.poses.get(keyframe) or facts.poses.get("", {})
    start = {joint: pose[joint] for joint in order if joint in pose}
    if not start:
        return None
    is_direct = all(actuator.unit in ("rad", "m") for actuator in facts.actuators)
    return RobotJoints(
        start=start,
        driven=driven if driven and all(joint in pose for joint in driven) else (),
        are_servos=is_direct,
    )


def _of_joint(facts: ModelFacts, joint: str, kind: str) -> tuple[SensorFact, ...]:
    sensors = facts.sensors.values()
    found = (s for s in sensors if s.type == kind and s.object_name == joint)
    return tuple(found)[:1]


def _at_objects(
    facts: ModelFacts, message: str, topic: str, needed: Sequence[str]
) -> Iterator[ModelSensors]:
    takes = SENSOR_GROUPS[message].takes
    by_object: dict[tuple[str, str], dict[str, str]] = {}
    for sensor in facts.sensors.values():
        if sensor.type in takes and (message != "ObkImu" or sensor.object_type == "site"):
            place = by_object.setdefault((sensor.object_type, sensor.object_name), {})
            place.setdefault(sensor.type, sensor.name)
    whole = {place[1]: found for place, found in by_object.items() if {*needed} <= {*found}}
    for name, found in whole.items():
        missing = {kind for kind in takes if kind not in found}
        yield ModelSensors(
            topic=topic if len(whole) == 1 else f"{topic}_{_topic_word(name)}",
            message=message,
            sensors={found[kind]: kind for kind in takes if kind in found},
            ignored=("OBK307",) if missing else (),
        )


def _topic_word(name: str) -> str:
    word = "".join(c if c.isascii() and c.isalnum() else "_" for c in name).strip("_")
    return word or "body"


def _forces(facts: ModelFacts) -> Iterator[ModelSensors]:
    takes = SENSOR_GROUPS["ObkForceSensor"].takes
    found = {s.name: s.type for s in facts.sensors.values() if s.type in takes}
    if found:
        yield ModelSensors(topic="forces", message="ObkForceSensor", sensors=found)


@dataclass(frozen=True, slots=True, kw_only=True)
class Supplement:
    """A model that includes another and adds missing elements."""

    text: str
    added: str
    """The added elements, as words."""


def supplement(facts: ModelFacts, included: str) -> Supplement | None:
    """Add what a model lacks as a simulated robot; None if it is complete.

    Each hinge and slide gets a `jointpos` and a `jointvel` sensor. If the model has no actuators,
    each also gets a motor.

    Args:
        facts: the incomplete model.
        included: path of its file, relative to the folder of the new one.
    """
    joints = scalar_joints(facts)
    used = set(facts.sensors)
    sensors = []
    for kind, suffix in (("jointpos", "pos"), ("jointvel", "vel")):
        for joint in (j for j in joints if not _of_joint(facts, j, kind)):
            name = next(n for n in _names(f"{joint}_{suffix}") if n not in used)
            used.add(name)
            sensors.append(f"    <{kind} name={quoteattr(name)} joint={quoteattr(joint)}/>")
    motors = [] if facts.actuators else [_motor(joint) for joint in joints]
    if not sensors and not motors:
        return None
    what = [with_number(len(motors), "motor")] if motors else []
    what += [with_number(len(sensors), "encoder")] if sensors else []
    added = " and ".join(what)
    lines = (
        "<mujoco>",
        f"  <!-- Adds to the robot's model: {added}. -->",
        f"  <include file={quoteattr(included)}/>",
        *_section("actuator", motors),
        *_section("sensor", sensors),
        "</mujoco>\n",
    )
    return Supplement(text="\n".join(lines), added=added)


def _motor(joint: str) -> str:
    return f"    <motor name={quoteattr(f'{joint}_motor')} joint={quoteattr(joint)}/>"


def _names(name: str) -> Iterator[str]:
    yield name
    number = 2
    while True:
        yield f"{name}_{number}"
        number += 1


def _section(tag: str, lines: Sequence[str]) -> tuple[str, ...]:
    return (f"  <{tag}>", *lines, f"  </{tag}>") if lines else ()


def describe_robot(robot: RobotModel) -> tuple[str, ...]:
    """Sentences about what was added to a model or left out, and how well its pose is held."""
    hold, unit = robot.hold, _unit(robot.hold.actuators)
    pose = f"the `{hold.keyframe}` keyframe" if hold.keyframe else "the initial pose of the model"
    added = (f"{robot.path} includes the model and adds {robot.added}",) if robot.added else ()
    added = (*added, *robot.unused)
    if not _poses(hold.actuators):
        return (*added, f"the controller sends the controls of {pose}: no actuator drives a joint")
    return (
        *added,
        f"the controller holds {pose}; in 2 s of simulation no driven joint leaves it by more than "
        f"{hold.drift:.2g} {unit}",
    )


def model_variables(robot: RobotModel) -> dict[str, object]:
    """The template variables of a workspace for a given model."""
    hold = robot.hold
    return {
        "model_path": robot.path,
        "model_path_yaml": _yaml(robot.path),
        "period": f"{robot.period_s:g}",
        "groups": tuple(_group_variables(group) for group in robot.groups),
        "keyframe": hold.keyframe,
        "keyframe_yaml": _yaml(hold.keyframe),
        "is_torque": hold.is_torque,
        "ctrl_msg": "PDFeedForward" if hold.is_torque else "PositionSetpoint",
        "has_feedback": hold.has_feedback,
        "unit": _unit(hold.actuators),
        "controls": len(hold.actuators),
        "joints": _python_tuple([quoted(a.joint) for a in hold.actuators], indent=0),
        "lists": {name: _lists(hold, name) for name in ("pose", "setpoint", "kp", "kd")},
        "has_driven": bool(_poses(hold.actuators)),
        "test_pose": _python_tuple(
            [repr(pose) for pose in _poses(hold.actuators).values()], indent=0
        ),
        "tolerance": f"{_tolerance(hold.drift):g}",
        "drift": f"{hold.drift:.2g}",
    }


def _group_variables(group: ModelSensors) -> dict[str, object]:
    return {
        "topic": group.topic,
        "message": group.message,
        "sensors": {_yaml(name): kind for name, kind in group.sensors.items()},
        "is_read": group.message == "ObkJointEncoders",
        "ignored": ", ".join(group.ignored),
    }


_PLAIN = re.compile(r"[A-Za-z_][\w./-]*", re.ASCII)


def _yaml(text: str) -> str:
    """A YAML string; MuJoCo allows any character in a name."""
    is_plain = _PLAIN.fullmatch(text) and core_scalar(text) == text
    return text if is_plain else quoted(text)


def _lists(hold: Hold, name: str) -> dict[str, str]:
    """One number per actuator, in Python and YAML syntax."""
    values = [repr(getattr(actuator, name)) for actuator in hold.actuators]
    yaml = f"{name}: [{', '.join(values)}]"
    wrapped = textwrap.wrap(yaml, LINE_LENGTH - 6, subsequent_indent="  ")
    return {
        "python": _python_tuple(values, indent=8),
        "yaml": "\n".join(f"      {line}" for line in wrapped),
    }


def _poses(actuators: Iterable[HeldActuator]) -> dict[str, float]:
    """Joint -> pose, each joint once."""
    return {actuator.joint: actuator.pose for actuator in actuators if actuator.joint}


def _unit(actuators: Iterable[HeldActuator]) -> str:
    kinds = {actuator.is_slide for actuator in actuators if actuator.joint}
    if len(kinds) > 1:
        return "rad or m"
    return "m" if True in kinds else "rad"


def _tolerance(drift: float) -> float:
    """More than the drift, because the simulation with real processes has a larger delay."""
    return float(f"{max(2.0 * drift, 0.02):.1g}")


def _python_tuple(values: Sequence[str], *, indent: int) -> str:
    """A tuple of these items after `NAME = ` or an open bracket, formatted as by ruff."""
    margin = " " * indent
    line = f"({', '.join(values)}{',' if len(values) == 1 else ''})"
    if indent + len("JOINTS = ,") + len(line) <= LINE_LENGTH:
        return line
    return "\n".join(["(", *(f"{margin}    {value}," for value in values), f"{margin})"])
