"""The piece of a config that puts a new node into a stack.

In: the answers, and under which name the topics are. Out: YAML text for the section's list.
"""

from dataclasses import dataclass

from obk_cli.scaffold.fields import control_filling
from obk_cli.scaffold.questions import Answers, MessageType

__all__ = ["EXAMPLE_TOPICS", "Wire", "config_snippet", "sensor_topic", "wires_of"]

EXAMPLE_TOPICS = "/obelisk/dummy"
"""Where the dummy example has its topics."""

_SENSOR_TOPICS = {
    "obelisk_sensor_msgs/msg/JointEncoders": "joint_encoders",
    "obelisk_sensor_msgs/msg/ObkJointEncoders": "obk_joint_encoders",
    "obelisk_sensor_msgs/msg/ObkImu": "imu",
    "obelisk_sensor_msgs/msg/ObkFramePose": "framepose",
}
_PERIOD_S = {"controller": 0.001, "estimator": 0.001, "robot": 0.001, "sensor": 0.01}


@dataclass(frozen=True, slots=True, kw_only=True)
class Wire:
    """A publisher or subscriber of a node: its ROS parameter, its topic and its message type."""

    ros_parameter: str
    topic: str
    message: MessageType


def sensor_topic(message: MessageType, topics: str = EXAMPLE_TOPICS) -> str:
    """The topic of a kind of sensor message."""
    return f"{topics}/{_SENSOR_TOPICS.get(message.full, 'sensor')}"


def wires_of(answers: Answers, topics: str = EXAMPLE_TOPICS) -> dict[str, tuple[Wire, ...]]:
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
        "publishers": (_wire(*publisher),),
        "subscribers": (_wire(*subscriber),) if subscriber else (),
    }


def config_snippet(answers: Answers, topics: str = EXAMPLE_TOPICS) -> str:
    """The node as one entry of a section's list."""
    timers = {"controller": "timer_ctrl_setting", "estimator": "timer_est_setting"}
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
            f"    - ros_parameter: {timers.get(answers.kind, 'timer_sensor_setting')}",
            f"      timer_period_sec: {_PERIOD_S[answers.kind]}",
        ]
    )


def _wire(name: str, topic: str, message: MessageType) -> Wire:
    return Wire(ros_parameter=f"{name}_setting", topic=topic, message=message)


def _parameter_lines(answers: Answers) -> tuple[str, ...]:
    """The parameters that the generated node declares."""
    is_python_controller = answers.kind == "controller" and answers.language == "py"
    if is_python_controller and control_filling(answers.ctrl).uses_math:
        return ("  params:", "    amplitude: 1.0")
    return ()


def _lines(wire: Wire) -> tuple[str, ...]:
    return (
        f"    - ros_parameter: {wire.ros_parameter}",
        f"      topic: {wire.topic}",
        f"      msg_type: {wire.message.spelling}",
    )
