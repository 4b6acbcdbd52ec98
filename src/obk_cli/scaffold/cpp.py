"""How C++ names message types, and which fields of them a generated node fills.

In: message types. Out: the class and its header, as ROS 2's C++ generator names them, and
statements. Only messages whose fields this project defines are filled. Never touches the disk.
"""

import re

from obk_cli.scaffold.message_code import has_header, is_position_control
from obk_cli.scaffold.questions import MessageType

__all__ = ["cpp_control", "cpp_estimate", "cpp_header", "cpp_type"]

_WORD_STARTS = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Za-z0-9])(?=[A-Z][a-z])")
_STAMP = "msg.header.stamp = this->get_clock()->now();"
_STAMP_OF_SENSOR = "msg.header.stamp = sensor_msg_->header.stamp;"
_UNKNOWN = ("// The other fields of msg are yours to fill.",)
_TIME = "const double time_s = this->get_clock()->now().seconds();"
_VELOCITY = (_TIME, "msg.v_x = std::sin(time_s);  // [m/s] your control law goes here")
_ESTIMATE = {
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
    """How `ComputeControl` fills its message; `controls` are the model's actuators."""
    if is_position_control(ctrl):
        law = f"msg.u_mujoco.assign({controls}, std::sin(time_s));  // your control law goes here"
        return _stamped(ctrl, (_TIME, law))
    is_velocity = ctrl.full == "obelisk_control_msgs/msg/VelocityCommand"
    return _stamped(ctrl, _VELOCITY if is_velocity else _UNKNOWN)


def cpp_estimate(est: MessageType, sensor: MessageType) -> tuple[str, ...]:
    """How `ComputeStateEstimate` fills its message from the newest sensor message."""
    stamp = _STAMP_OF_SENSOR if has_header(sensor) else _STAMP
    return _stamped(est, _ESTIMATE.get((est.full, sensor.full), _UNKNOWN), stamp)


def _stamped(
    message: MessageType, statements: tuple[str, ...], stamp: str = _STAMP
) -> tuple[str, ...]:
    return (stamp, *statements) if has_header(message) else statements
