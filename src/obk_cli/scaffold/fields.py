"""Which fields of a message the generated node fills, as lines of Python.

In: message types. Out: statements for the node and assertions for its test. Only messages whose
fields this project defines are filled; of any other only what is sure is written.
"""

from dataclasses import dataclass

from obk_cli.scaffold.questions import MessageType

__all__ = ["Filling", "control_filling", "estimate_filling"]

_STAMP = "msg.header.stamp = self.get_clock().now().to_msg()"
_WITHOUT_HEADER = frozenset({"obelisk_sensor_msgs/msg/ObkImage"})
_WITH_HEADER_PACKAGES = ("obelisk_control_msgs", "obelisk_estimator_msgs", "obelisk_sensor_msgs")


@dataclass(frozen=True, slots=True, kw_only=True)
class Filling:
    """Lines that fill a message called `msg`, and lines of the test that look at it.

    `sample` are lines of the test that fill the sensor message called `reading`.
    """

    statements: tuple[str, ...]
    assertions: tuple[str, ...] = ()
    sample: tuple[str, ...] = ()

    @property
    def uses_math(self) -> bool:
        """Whether the statements need `import math`."""
        return any("math." in line for line in self.statements)


_U_MUJOCO = Filling(
    statements=(
        "u = self.amplitude * math.sin(self.t)  # your control law goes here",
        "msg.u_mujoco = [u]",
    ),
    assertions=("assert len(msg.u_mujoco) == 1", "assert abs(msg.u_mujoco[0]) <= 1.0"),
)
_CONTROL = {
    "obelisk_control_msgs/msg/PositionSetpoint": _U_MUJOCO,
    "obelisk_control_msgs/msg/PDFeedForward": _U_MUJOCO,
    "obelisk_control_msgs/msg/VelocityCommand": Filling(
        statements=(
            "msg.v_x = self.amplitude * math.sin(self.t)  # [m/s] your control law goes here",
            "msg.v_y = 0.0  # [m/s]",
            "msg.w_z = 0.0  # [rad/s]",
        ),
        assertions=("assert abs(msg.v_x) <= 1.0",),
    ),
}
_ESTIMATE = {
    (
        "obelisk_estimator_msgs/msg/EstimatedState",
        "obelisk_sensor_msgs/msg/JointEncoders",
    ): Filling(
        statements=("msg.q_joints = self.sensor_msg.y",),
        sample=("reading.y = [0.25, -0.5]",),
        assertions=("assert list(msg.q_joints) == [0.25, -0.5]",),
    ),
    (
        "obelisk_estimator_msgs/msg/EstimatedState",
        "obelisk_sensor_msgs/msg/ObkJointEncoders",
    ): Filling(
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


def control_filling(ctrl: MessageType) -> Filling:
    """How `compute_control` fills its message."""
    return _stamped(ctrl, _CONTROL.get(ctrl.full))


def estimate_filling(est: MessageType, sensor: MessageType) -> Filling:
    """How `compute_state_estimate` fills its message from the newest sensor message."""
    return _stamped(est, _ESTIMATE.get((est.full, sensor.full)))


def _stamped(message: MessageType, filling: Filling | None) -> Filling:
    known = filling or Filling(statements=("# the other fields of msg are yours to fill",))
    if not _has_header(message):
        return known
    return Filling(
        statements=(_STAMP, *known.statements),
        assertions=known.assertions,
        sample=known.sample,
    )


def _has_header(message: MessageType) -> bool:
    if message.package in _WITH_HEADER_PACKAGES:
        return message.full not in _WITHOUT_HEADER
    return message.package.endswith("_msgs") and message.name.endswith("Stamped")
