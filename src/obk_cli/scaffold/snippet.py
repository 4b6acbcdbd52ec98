"""The piece of a config that puts a new node into a stack.

In: the answers. Out: YAML text for the section's list, with the dummy example's topics.
"""

from dataclasses import dataclass

from obk_cli.scaffold.fields import control_filling
from obk_cli.scaffold.questions import Answers, MessageType

__all__ = ["SECTIONS", "config_snippet"]

SECTIONS = {"controller": "control", "estimator": "estimation"}
"""The section of the config that a kind of node belongs to."""

_SENSOR_TOPICS = {
    "obelisk_sensor_msgs/msg/JointEncoders": "/obelisk/dummy/joint_encoders",
    "obelisk_sensor_msgs/msg/ObkJointEncoders": "/obelisk/dummy/obk_joint_encoders",
    "obelisk_sensor_msgs/msg/ObkImu": "/obelisk/dummy/imu",
    "obelisk_sensor_msgs/msg/ObkFramePose": "/obelisk/dummy/framepose",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Wiring:
    """The components of a kind of node: (ROS parameter, topic, message type), and its timer."""

    publisher: tuple[str, str, MessageType]
    subscriber: tuple[str, str, MessageType]
    timer: str


def config_snippet(answers: Answers) -> str:
    """The node as one entry of a section's list."""
    wiring = _wire(answers)
    return "\n".join(
        [
            f"- pkg: {answers.package}",
            f"  executable: {answers.node}",
            *_parameter_lines(answers),
            "  publishers:",
            *_topic_lines(*wiring.publisher),
            "  subscribers:",
            *_topic_lines(*wiring.subscriber),
            "  timers:",
            f"    - ros_parameter: {wiring.timer}",
            "      timer_period_sec: 0.001",
        ]
    )


def _parameter_lines(answers: Answers) -> tuple[str, ...]:
    """The parameters that the generated node declares."""
    if answers.kind == "controller" and control_filling(answers.ctrl).uses_math:
        return ("  params:", "    amplitude: 1.0")
    return ()


def _wire(answers: Answers) -> _Wiring:
    estimate = "/obelisk/dummy/est"
    if answers.kind == "controller":
        return _Wiring(
            publisher=("pub_ctrl_setting", "/obelisk/dummy/ctrl", answers.ctrl),
            subscriber=("sub_est_setting", estimate, answers.est),
            timer="timer_ctrl_setting",
        )
    sensor = _SENSOR_TOPICS.get(answers.sensor.full, "/obelisk/dummy/sensor")
    return _Wiring(
        publisher=("pub_est_setting", estimate, answers.est),
        subscriber=("sub_sensor_setting", sensor, answers.sensor),
        timer="timer_est_setting",
    )


def _topic_lines(ros_parameter: str, topic: str, message: MessageType) -> tuple[str, ...]:
    return (
        f"    - ros_parameter: {ros_parameter}",
        f"      topic: {topic}",
        f"      msg_type: {message.spelling}",
    )
