"""The piece of a config that puts a new node into a stack.

In: the answers, and under which name the topics are. Out: YAML text for the section's list.
"""

from dataclasses import dataclass

from obk_cli.scaffold.fields import control_filling
from obk_cli.scaffold.questions import Answers, MessageType

__all__ = ["TOPICS_TO_FILL_IN", "Wire", "config_snippet", "sensor_topic", "wires_of"]

TOPICS_TO_FILL_IN = "/STACK"
"""Stands for what the topics of a stack begin with, where no stack is known."""

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


def sensor_topic(message: MessageType, topics: str = TOPICS_TO_FILL_IN) -> str:
    """The topic of a kind of sensor message."""
    return f"{topics}/{_SENSOR_TOPICS.get(message.full, 'sensor')}"


def wires_of(answers: Answers, topics: str = TOPICS_TO_FILL_IN) -> dict[str, tuple[Wire, ...]]:
    """What a kind of node has under `publishers` and under `subscribers`."""
    ctrl = (f"{topics}/ctrl", answers.ctrl)
    est = (f"{topics}/est", answers.est)
    sensor = (sensor_topic(answers.sensor, topics), answers.sensor)
    sends = {"controller": ("pub_ctrl", *ctrl), "estimator": ("pub_est", *est)}
    hears = {
        "controller": ("sub_est", *est),
        "estimator": ("sub_sensor", *sensor),
        "robot": ("sub_ctrl", *ctrl),
    }
    publisher = sends.get(answers.kind, ("pub_sensor", *sensor))
    subscriber = hears.get(answers.kind)
    return {
        "publishers": (Wire(*publisher),),
        "subscribers": (Wire(*subscriber),) if subscriber else (),
    }


def config_snippet(answers: Answers, topics: str = TOPICS_TO_FILL_IN) -> str:
    """The node as one entry of a section's list."""
    timers = {"controller": "timer_ctrl", "estimator": "timer_est"}
    return "\n".join(
        [
            f"- pkg: {answers.package}",
            f"  executable: {answers.node}",
            *(("  is_simulated: false",) if answers.kind == "robot" else ()),
            *_parameter_lines(answers),
            *(
                line
                for name, wires in wires_of(answers, topics).items()
                if wires
                for line in (f"  {name}:", *(line for wire in wires for line in _lines(wire)))
            ),
            "  timers:",
            f"    - key: {timers.get(answers.kind, 'timer_sensor')}",
            f"      timer_period_sec: {_PERIOD_S[answers.kind]}",
        ]
    )


def _parameter_lines(answers: Answers) -> tuple[str, ...]:
    """The parameters that the generated node declares."""
    is_python_controller = answers.kind == "controller" and answers.language == "py"
    if is_python_controller and control_filling(answers.ctrl).uses_math:
        return ("  params:", "    amplitude: 1.0")
    return ()


def _lines(wire: Wire) -> tuple[str, ...]:
    return (
        f"    - key: {wire.key}",
        f"      topic: {wire.topic}",
        f"      msg_type: {wire.message.spelling}",
    )
