"""What the nodes of a loop do at their ticks and their messages, whatever they inherit from.

The simulator stamps its encoders with the monotonic clock; estimator and controller hand the stamp
on; so the simulator knows how old the sensor values are that a control message is made from.
"""

import time
from abc import ABC, abstractmethod
from typing import Any

from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import ObkJointEncoders

from benchmarks.loop.record import Notes

__all__ = ["HISTORY_DEPTH", "Work", "work_of"]

NS_PER_S = 10**9
HISTORY_DEPTH = 10


class Work(ABC):
    """One node's work."""

    sends: type[Any]
    hears: type[Any]
    topic_out: str
    topic_in: str

    def __init__(self, loop: str, joints: int) -> None:
        self.notes = Notes()
        self.publishes_on = f"/loop_{loop}/{self.topic_out}"
        self.subscribes_to = f"/loop_{loop}/{self.topic_in}"
        self._newest: Any = None
        self._numbers = [0.5] * joints
        self._names = [f"joint_{number:03}" for number in range(joints)]

    def hear(self, message: Any) -> None:
        """Keep a message."""
        self.notes.has_heard = True
        self._newest = message

    def tick(self) -> Any:
        """Note the time; the message to publish."""
        self.notes.ticks_ns.append(time.monotonic_ns())
        return self._message()

    @abstractmethod
    def _message(self) -> Any: ...


class _Sim(Work):
    sends, hears = ObkJointEncoders, PositionSetpoint
    topic_out, topic_in = "encoders", "control"

    def hear(self, message: Any) -> None:
        now_ns = time.monotonic_ns()
        stamp = message.header.stamp
        if stamp.sec:
            self.notes.arrivals_ns.append(now_ns)
            self.notes.delays_ns.append(now_ns - stamp.sec * NS_PER_S - stamp.nanosec)
        super().hear(message)

    def _message(self) -> ObkJointEncoders:
        message = ObkJointEncoders()
        message.joint_pos = self._numbers
        message.joint_vel = self._numbers
        message.joint_names = self._names
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(time.monotonic_ns(), NS_PER_S)
        return message


class _Est(Work):
    sends, hears = EstimatedState, ObkJointEncoders
    topic_out, topic_in = "estimate", "encoders"

    def _message(self) -> EstimatedState:
        message = EstimatedState()
        encoders = self._newest
        if encoders is not None:
            message.header.stamp = encoders.header.stamp
            message.q_joints = encoders.joint_pos
            message.v_joints = encoders.joint_vel
            message.joint_names = encoders.joint_names
        return message


class _Ctrl(Work):
    sends, hears = PositionSetpoint, EstimatedState
    topic_out, topic_in = "control", "estimate"

    def _message(self) -> PositionSetpoint:
        message = PositionSetpoint()
        message.u_mujoco = self._numbers
        if self._newest is not None:
            message.header.stamp = self._newest.header.stamp
        return message


_KINDS: dict[str, type[Work]] = {"sim": _Sim, "est": _Est, "ctrl": _Ctrl}


def work_of(name: str, joints: int) -> Work:
    """The work of a node, by its name: `est_0` estimates in the first loop."""
    role, _, loop = name.partition("_")
    return _KINDS[role](loop, joints)
