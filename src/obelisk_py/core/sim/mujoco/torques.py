"""`PDFeedForward` with gains: from the message to a torque for each joint, at every step.

In: messages, a model and its state. Out: a checked `TorqueLaw`, or a sentence why it is refused;
controls of shape (nu,) by which the actuators have those torques.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.sim.mujoco.actuators import Actuators
from obelisk_py.core.sim.mujoco.bounds import LARGEST, out_of_bounds

__all__ = ["JointTorques", "TorqueLaw", "has_gains"]

Numbers = NDArray[np.float64]

_FIELDS = ("pos_target", "vel_target", "feed_forward", "kp", "kd")
_JOINT_DRIVES = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_OF_ONE_NUMBER = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueLaw:
    """torque = kp (pos_target - position) + kd (vel_target - velocity) + feed_forward.

    Each field has the shape (nu,), in the order of the actuators; units as in `PDFeedForward`.
    """

    pos_target: Numbers
    vel_target: Numbers
    feed_forward: Numbers
    kp: Numbers
    kd: Numbers


def has_gains(message: Any) -> bool:
    """Whether a `PDFeedForward` asks for torques; without gains its `u_mujoco` counts."""
    return bool(len(message.kp) or len(message.kd))


class JointTorques:
    """The joints that a model's actuators drive."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Find the joint of each actuator."""
        self._actuators = Actuators(model)
        self._joints = model.actuator_trnid[:, 0].copy()
        self._names = tuple(
            mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) or "" if joint >= 0 else ""
            for joint in self._joints
        )
        self._unfit = self._why_unfit(model)
        if self._unfit is None:
            self._positions = model.jnt_qposadr[self._joints]
            self._velocities = model.jnt_dofadr[self._joints]
            self._gear = model.actuator_gear[:, 0].copy()

    def read(self, message: Any) -> TorqueLaw | str:
        """The law of a `PDFeedForward`, or why it is refused.

        An empty `vel_target`, `feed_forward`, `kp` or `kd` is zero; `pos_target` may be empty where
        `kp` is.
        """
        if self._unfit is not None:
            return self._unfit
        order = self._order_of(message.joint_names)
        if isinstance(order, str):
            return order
        count = len(self._joints)
        read: dict[str, Numbers] = {}
        for field in _FIELDS:
            values = np.array(getattr(message, field), dtype=np.float64)
            may_be_empty = field != "pos_target" or len(message.kp) == 0
            if values.size == 0 and may_be_empty:
                values = np.zeros(count)
            if values.size != count:
                return f"`{field}` has the length {values.size}, the model has {count} joints"
            fault = out_of_bounds(field, values)
            if fault is not None:
                return fault
            read[field] = values[order]
        return TorqueLaw(**read)

    def control(self, law: TorqueLaw, data: mujoco.MjData) -> Numbers:
        """The control by which each joint has the torque that the law asks for in this state."""
        torque = (
            law.kp * (law.pos_target - data.qpos[self._positions])
            + law.kd * (law.vel_target - data.qvel[self._velocities])
            + law.feed_forward
        )
        control = self._actuators.control_for(
            torque / self._gear, data.actuator_length, data.actuator_velocity
        )
        return np.clip(control, -LARGEST, LARGEST)

    def _order_of(self, names: Sequence[str]) -> NDArray[np.intp] | str:
        """Where each actuator's joint stands in the message."""
        if not names:
            return np.arange(len(self._joints))
        if sorted(names) != sorted(self._names):
            listed = ", ".join(f"`{name}`" for name in self._names)
            return f"`joint_names` are not the joints that the model drives: {listed}"
        places = {name: place for place, name in enumerate(names)}
        return np.array([places[name] for name in self._names], dtype=np.intp)

    def _why_unfit(self, model: mujoco.MjModel) -> str | None:
        for index, joint in enumerate(self._joints):
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, index) or index
            if (
                model.actuator_trntype[index] not in _JOINT_DRIVES
                or model.jnt_type[joint] not in _OF_ONE_NUMBER
                or model.actuator_gear[index, 0] == 0
            ):
                return f"gains are for joints, and the actuator `{name}` drives no hinge or slide"
            if not self._actuators.take_forces[index]:
                return f"the actuator `{name}` takes no torque"
            if joint in self._joints[:index]:
                return f"two actuators drive the joint `{self._names[index]}`"
        return None
