"""The work of a loop's nodes at ticks and messages, independent of their base class.

The simulator stamps its encoders with the monotonic clock, and estimator and controller copy the
stamp. So the simulator knows the age of the sensor values behind each control message.
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
    """The work of one node."""

    sends: type[Any]
    receives: type[Any]
    topic_out: str
    topic_in: str

    def __init__(self, loop: str, joints: int) -> None:
        self.notes = Notes()
        self.publishes_on = f"/loop_{loop}/{self.topic_out}"
        self.subscribes_to = f"/loop_{loop}/{self.topic_in}"
        self._newest: Any = None
        self._numbers = [0.5] * joints
        self._names = [f"joint_{number:03}" for number in range(joints)]

    def receive(self, message: Any) -> None:
        """Store a message."""
        self.notes.has_received = True
        self._newest = message

    def tick(self) -> Any:
        """Record the time and return the message to publish."""
        self.notes.ticks_ns.append(time.monotonic_ns())
        return self._message()

    @abstractmethod
    def _message(self) -> Any: ...


class _Sim(Work):
    sends, receives = ObkJointEncoders, PositionSetpoint
    topic_out, topic_in = "encoders", "control"

    def receive(self, message: Any) -> None:
        now_ns = time.monotonic_ns()
        stamp = message.header.stamp
        if stamp.sec:
            self.notes.arrivals_ns.append(now_ns)
            self.notes.delays_ns.append(now_ns - stamp.sec * NS_PER_S - stamp.nanosec)
        super().receive(message)

    def _message(self) -> ObkJointEncoders:
        message = ObkJointEncoders()
        message.joint_pos = self._numbers
        message.joint_vel = self._numbers
        message.joint_names = self._names
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(time.monotonic_ns(), NS_PER_S)
        return message


class _Est(Work):
    sends, receives = EstimatedState, ObkJointEncoders
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
    sends, receives = PositionSetpoint, EstimatedState
    topic_out, topic_in = "control", "estimate"

    def _message(self) -> PositionSetpoint:
        message = PositionSetpoint()
        message.u_mujoco = self._numbers
        if self._newest is not None:
            message.header.stamp = self._newest.header.stamp
        return message


_KINDS: dict[str, type[Work]] = {"sim": _Sim, "est": _Est, "ctrl": _Ctrl}


def work_of(name: str, joints: int) -> Work:
    """The work of a node by its name: `est_0` is the estimator of the first loop."""
    role, _, loop = name.partition("_")
    return _KINDS[role](loop, joints)
