"""Generate code for message types: the fields that a new node fills, and sorted import lines.

Pure: returns lines of Python and C++ code, and the class and header of a type as named by ROS 2's
C++ generator. Only messages whose fields this project defines are filled.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from obk_cli.scaffold.package_spec import MessageType

__all__ = [
    "LINE_LENGTH",
    "MessageCode",
    "control_code",
    "cpp_control",
    "cpp_estimate",
    "cpp_header",
    "cpp_type",
    "estimate_code",
    "has_header",
    "import_block",
    "joints_code",
    "message_imports",
    "names_code",
    "position_field",
    "quoted",
    "reading_code",
]

_STAMP = "msg.header.stamp = self.get_clock().now().to_msg()"
_STAMP_OF_SENSOR = "msg.header.stamp = self.sensor_msg.header.stamp"
"""Copying the stamp reveals a silent sensor by the age of the data derived from it."""
_HEADER = re.compile(r"^\s*std_msgs/(?:msg/)?Header\s+header\b", re.MULTILINE)
_WITHOUT_HEADER = frozenset({"obelisk_sensor_msgs/msg/ObkImage"})
_WITH_HEADER_PACKAGES = ("obelisk_control_msgs", "obelisk_estimator_msgs", "obelisk_sensor_msgs")


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageCode:
    """Lines that fill a message named `msg`, and lines of a test that check it.

    `sample` are lines of the test that fill the sensor message named `reading`.
    """

    statements: tuple[str, ...]
    assertions: tuple[str, ...] = ()
    sample: tuple[str, ...] = ()
    unit: str = ""
    """Unit of the control's amplitude or of the readings; empty if it depends on the model."""

    @property
    def uses_math(self) -> bool:
        """Whether the statements need `import math`."""
        return any("math." in line for line in self.statements)


_WITH_U_MUJOCO = frozenset(
    {"obelisk_control_msgs/msg/PositionSetpoint", "obelisk_control_msgs/msg/PDFeedForward"}
)
_LONGEST_LIST = 6
"""Maximum number of controls written one by one; more are written as a product."""
_VELOCITY = MessageCode(
    statements=(
        "msg.v_x = self.amplitude * math.sin(self.t)  # [m/s] your control law goes here",
        "msg.v_y = 0.0  # [m/s]",
        "msg.w_z = 0.0  # [rad/s]",
    ),
    assertions=("assert abs(msg.v_x) <= 1.0",),
    unit="m/s",
)
_ESTIMATE = {
    (
        "obelisk_estimator_msgs/msg/EstimatedState",
        "obelisk_sensor_msgs/msg/JointEncoders",
    ): MessageCode(
        statements=("msg.q_joints = self.sensor_msg.y",),
        sample=("reading.y = [0.25, -0.5]",),
        assertions=("assert list(msg.q_joints) == [0.25, -0.5]",),
    ),
    (
        "obelisk_estimator_msgs/msg/EstimatedState",
        "obelisk_sensor_msgs/msg/ObkJointEncoders",
    ): MessageCode(
        statements=(
            "msg.joint_names = self.sensor_msg.joint_names",
            "msg.q_joints = self.sensor_msg.joint_pos",
            "msg.v_joints = self.sensor_msg.joint_vel",
        ),
        sample=("reading.joint_pos = [0.25]", "reading.joint_vel = [-0.5]"),
        assertions=(
            "assert list(msg.q_joints) == [0.25]",
            "assert list(msg.v_joints) == [-0.5]",
        ),
    ),
}


def control_code(ctrl: MessageType, controls: int = 1) -> MessageCode:
    """Code of `compute_control` that fills its message; `controls` are the model's actuators."""
    if ctrl.full in _WITH_U_MUJOCO:
        return _stamped(ctrl, _u_mujoco(controls))
    is_velocity = ctrl.full == "obelisk_control_msgs/msg/VelocityCommand"
    return _stamped(ctrl, _VELOCITY if is_velocity else None)


def _u_mujoco(controls: int) -> MessageCode:
    is_short = controls <= _LONGEST_LIST
    values = f"[{', '.join(['u'] * controls)}]" if is_short else f"[u] * {controls}"
    return MessageCode(
        statements=(
            "u = self.amplitude * math.sin(self.t)  # your control law goes here",
            f"msg.u_mujoco = {values}",
        ),
        assertions=(
            f"assert len(msg.u_mujoco) == {controls}",
            "assert abs(msg.u_mujoco[0]) <= 1.0",
        ),
    )


def estimate_code(est: MessageType, sensor: MessageType) -> MessageCode:
    """Code of `compute_state_estimate` that fills its message from the latest sensor message."""
    known = _ESTIMATE.get((est.full, sensor.full))
    if not (has_header(est) and has_header(sensor)):
        return _stamped(est, known)
    code = _stamped(est, known, _STAMP_OF_SENSOR)
    return replace(
        code,
        sample=("reading.header.stamp.sec = 3", *code.sample),
        assertions=("assert msg.header.stamp.sec == 3", *code.assertions),
    )


def position_field(ctrl: MessageType) -> str:
    """The field with the positions that a control message commands; empty if it has none."""
    if ctrl.full == "obelisk_control_msgs/msg/PDFeedForward":
        return "pos_target"
    return "u_mujoco" if ctrl.full in _WITH_U_MUJOCO else ""


def joints_code(positions: Mapping[str, float]) -> str:
    """Code of a dict with the positions of joints, as formatted by ruff after `JOINTS = `."""
    items = [f"{quoted(name)}: {round(position, 6)}" for name, position in positions.items()]
    return _collection(items, "{", "}", "JOINTS = ")


def names_code(names: Iterable[str]) -> str:
    """Code of a tuple of names, as formatted by ruff after `DRIVEN = `."""
    items = [quoted(name) for name in names]
    return _collection(items, "(", ",)" if len(items) == 1 else ")", "DRIVEN = ")


def _collection(items: Sequence[str], opening: str, closing: str, start: str) -> str:
    line = f"{opening}{', '.join(items)}{closing}"
    if len(start) + len(line) <= LINE_LENGTH:
        return line
    return "\n".join([opening, *(f"    {item}," for item in items), closing[-1]])


def quoted(text: str) -> str:
    """A string in double quotes, valid in Python and in YAML."""
    return json.dumps(text, ensure_ascii=False)


def reading_code(
    sensor: MessageType, positions: str, offset: str = "", names: str = ""
) -> MessageCode:
    """Code with which a robot or a sensor fills its message.

    Args:
        sensor: the message.
        positions: code for the joints' positions [rad or m].
        offset: prefix of other readings, such as `self.offset + `.
        names: code for the joints' names; empty if they have none.
    """
    codes = {
        "obelisk_sensor_msgs/msg/JointEncoders": MessageCode(
            statements=(f"msg.y = {positions}",), unit="rad"
        ),
        "obelisk_sensor_msgs/msg/ObkJointEncoders": MessageCode(
            statements=(
                *((f"msg.joint_names = {names}",) if names else ()),
                f"msg.joint_pos = {positions}",
                "msg.joint_vel = [0.0] * len(msg.joint_pos)",
            ),
            assertions=("assert len(msg.joint_pos) == len(msg.joint_vel)",),
            unit="rad",
        ),
        "obelisk_sensor_msgs/msg/ObkImu": MessageCode(
            statements=(
                "msg.orientation.w = 1.0",
                f"msg.linear_acceleration.z = {offset}9.81  # [m/s^2] at rest",
            ),
            unit="m/s^2",
            assertions=("assert msg.linear_acceleration.z > 0.0",),
        ),
        "obelisk_sensor_msgs/msg/ObkFramePose": MessageCode(
            statements=('msg.frame_name = "base"', "msg.orientation.w = 1.0"),
            assertions=("assert msg.orientation.w == 1.0",),
        ),
    }
    return _stamped(sensor, codes.get(sensor.full))


def _stamped(message: MessageType, code: MessageCode | None, stamp: str = _STAMP) -> MessageCode:
    known = code or MessageCode(statements=("# the other fields of msg are yours to fill",))
    if not has_header(message):
        return known
    return MessageCode(
        statements=(stamp, *known.statements),
        assertions=known.assertions,
        sample=known.sample,
        unit=known.unit,
    )


def has_header(message: MessageType) -> bool:
    """Whether a message has a header: by its definition, otherwise by its name."""
    if message.definition is not None:
        return _HEADER.search(message.definition) is not None
    if message.package in _WITH_HEADER_PACKAGES:
        return message.full not in _WITHOUT_HEADER
    return message.package.endswith("_msgs") and message.name.endswith("Stamped")


LINE_LENGTH = 100
"""Longest line of generated code [characters]."""


def message_imports(messages: Iterable[MessageType]) -> tuple[tuple[str, str], ...]:
    """The (module, class) pairs of message types."""
    return tuple((message.module, message.name) for message in messages)


def import_block(names: Iterable[tuple[str, str]]) -> str:
    """Sorted `from module import a, b` lines for (module, name) pairs, without duplicates."""
    by_module: dict[str, set[str]] = {}
    for module, name in names:
        by_module.setdefault(module, set()).add(name)
    return "\n".join(
        import_line(module, by_module[module]) for module in sorted(by_module, key=_natural)
    )


def import_line(module: str, names: Iterable[str]) -> str:
    """One `from module import ...`, in parentheses if it would be too long for a line."""
    ordered = sorted(names, key=_member_key)
    line = f"from {module} import {', '.join(ordered)}"
    if len(line) <= LINE_LENGTH:
        return line
    return "\n".join([f"from {module} import (", *(f"    {name}," for name in ordered), ")"])


def _member_key(name: str) -> tuple[object, ...]:
    """Sort key: constants, then classes, then the rest, as in isort's `order-by-type`."""
    rank = 0 if name.isupper() and len(name) > 1 else 1 if name[0].isupper() else 2
    return (rank, *_natural(name))


def _natural(name: str) -> tuple[object, ...]:
    """Sort key that puts `Int8` before `Int16`."""
    parts = re.split(r"(\d+)", name)
    return tuple(int(part) if part.isdigit() else part.lower() for part in parts)


_WORD_STARTS = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Za-z0-9])(?=[A-Z][a-z])")
_CPP_STAMP = "msg.header.stamp = this->get_clock()->now();"
_CPP_STAMP_OF_SENSOR = "msg.header.stamp = sensor_msg_->header.stamp;"
_CPP_UNKNOWN = ("// The other fields of msg are yours to fill.",)
_CPP_TIME = "const double time_s = this->get_clock()->now().seconds();"
_CPP_AMPLITUDE = 'const double amplitude = this->get_parameter("amplitude").as_double();'
_CPP_SINE = "amplitude * std::sin(time_s)"
_CPP_VELOCITY = f"msg.v_x = {_CPP_SINE};  // [m/s] your control law goes here"
_CPP_ESTIMATE = {
    (
        "obelisk_estimator_msgs/msg/EstimatedState",
        "obelisk_sensor_msgs/msg/JointEncoders",
    ): ("msg.q_joints = sensor_msg_->y;",),
    (
        "obelisk_estimator_msgs/msg/EstimatedState",
        "obelisk_sensor_msgs/msg/ObkJointEncoders",
    ): (
        "msg.joint_names = sensor_msg_->joint_names;",
        "msg.q_joints = sensor_msg_->joint_pos;",
        "msg.v_joints = sensor_msg_->joint_vel;",
    ),
}


def cpp_type(message: MessageType) -> str:
    """`std_msgs::msg::Int8`."""
    return f"{message.package}::msg::{message.name}"


def cpp_header(message: MessageType) -> str:
    """`std_msgs/msg/int8.hpp`; `PDFeedForward` is in `pd_feed_forward.hpp`."""
    return f"{message.package}/msg/{_WORD_STARTS.sub('_', message.name).lower()}.hpp"


def cpp_control(ctrl: MessageType, controls: int = 1) -> tuple[str, ...]:
    """Code of `ComputeControl` that fills its message; `controls` are the model's actuators."""
    if ctrl.full in _WITH_U_MUJOCO:
        law = f"msg.u_mujoco.assign({controls}, {_CPP_SINE});  // your control law goes here"
    elif ctrl.full == "obelisk_control_msgs/msg/VelocityCommand":
        law = _CPP_VELOCITY
    else:
        return _cpp_stamped(ctrl, _CPP_UNKNOWN)
    return _cpp_stamped(ctrl, (_CPP_TIME, _CPP_AMPLITUDE, law))


def cpp_estimate(est: MessageType, sensor: MessageType) -> tuple[str, ...]:
    """Code of `ComputeStateEstimate` that fills its message from the latest sensor message."""
    stamp = _CPP_STAMP_OF_SENSOR if has_header(sensor) else _CPP_STAMP
    return _cpp_stamped(est, _CPP_ESTIMATE.get((est.full, sensor.full), _CPP_UNKNOWN), stamp)


def _cpp_stamped(
    message: MessageType, statements: tuple[str, ...], stamp: str = _CPP_STAMP
) -> tuple[str, ...]:
    return (stamp, *statements) if has_header(message) else statements
