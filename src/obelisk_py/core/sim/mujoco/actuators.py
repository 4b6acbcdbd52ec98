"""Compute a model's actuator controls: force laws, brakes, and torques from gains.

The inputs are a compiled model, its state after mj_step1, and `PDFeedForward` messages with gains.
The outputs are controls of shape (nu,), or the reason to reject a message. The state is never
modified.

Source: https://mujoco.readthedocs.io/en/stable/computation/index.html (actuation model):
force = gain * ctrl + b0 + b1 * length + b2 * velocity, for a fixed gain and an affine bias.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from obelisk_spec.suggestions import list_names

__all__ = [
    "BRAKING_TIME_S",
    "LARGEST",
    "Actuators",
    "Brake",
    "JointTorques",
    "TorqueLaw",
    "has_gains",
    "out_of_limits",
]

LARGEST: Final = 1e10
"""If the magnitude of a number exceeds this, MuJoCo sets all controls to zero (mjMAXVAL)."""
BRAKING_TIME_S: Final = 0.1
"""Time in which a braked motor loses 63 % of its speed, if nothing else moves it [s].

It is based on the inertia that the motor feels while all other joints are free. This is the
smallest possible inertia, so that motors that brake together never overshoot. Coupled joints take
longer.
"""
_NONE: Final = int(mujoco.mjtDyn.mjDYN_NONE)
_FOLLOWING: Final = (
    _NONE,
    int(mujoco.mjtDyn.mjDYN_FILTER),
    int(mujoco.mjtDyn.mjDYN_FILTEREXACT),
)
"""Dynamics of actuators whose activation follows the control, immediately or with a delay."""
Numbers = NDArray[np.float64]
Flags = NDArray[np.bool_]
_FIELDS = ("pos_target", "vel_target", "feed_forward", "kp", "kd")
_JOINT_DRIVES = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_OF_ONE_NUMBER = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def out_of_limits(field: str, values: NDArray[np.float64]) -> str | None:
    """Describe the first non-finite or too large number, "`u_mujoco[1]` is nan", or None."""
    # For the length of a command, a loop is faster than NumPy.
    for index, value in enumerate(values.tolist()):
        if not -LARGEST <= value <= LARGEST:  # also for NaN
            return f"`{field}[{index}]` is {value:g}"
    return None


class Actuators:
    """The force laws of a model's actuators."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Read the force laws from a compiled model."""
        self.gain: Numbers = model.actuator_gainprm[:, 0].copy()
        """Force per unit of control, for actuators with a fixed gain, shape (nu,)."""
        self.bias: Numbers = model.actuator_biasprm[:, :3].copy()
        """b0, b1, b2 of actuators with an affine bias, shape (nu, 3)."""
        fixed = (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED) & (self.gain != 0)
        unbiased = model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE
        affine = model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE
        direct = model.actuator_dyntype == _NONE
        self.are_motors: Flags = fixed & unbiased & direct
        """Actuators whose force is proportional to the control."""
        self.are_servos: Flags = fixed & affine & np.isin(model.actuator_dyntype, _FOLLOWING)
        """Actuators whose control is a position or velocity."""
        self.take_forces: Flags = fixed & (unbiased | affine) & direct
        """Actuators that can produce any requested force."""
        self.bias[~affine] = 0.0
        limited = model.actuator_ctrllimited.astype(bool)
        self.least = np.where(limited, model.actuator_ctrlrange[:, 0], -np.inf)
        self.most = np.where(limited, model.actuator_ctrlrange[:, 1], np.inf)
        """Limits of the controls, with `least`, shape (nu,)."""

    def control_for(self, force: Numbers, length: Numbers, velocity: Numbers) -> Numbers:
        """Compute the control with which each force-capable actuator produces the given force.

        Args:
            force: force of each actuator, shape (nu,).
            length: `data.actuator_length`.
            velocity: `data.actuator_velocity`.
        """
        b0, b1, b2 = self.bias.T
        gain = np.where(self.take_forces, self.gain, 1.0)
        control: Numbers = (force - b0 - b1 * length - b2 * velocity) / gain
        return control


class Brake:
    """Stops a model with its actuators, starting from the state at construction.

    A motor's force opposes its velocity. A position servo holds its current position, and a
    velocity servo holds zero velocity. All other actuators get zero.
    """

    def __init__(self, actuators: Actuators, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Read the load inertia of each motor and the position of each servo."""
        b0, b1, _ = actuators.bias.T
        gain = np.where(actuators.gain == 0, 1.0, actuators.gain)
        hold = -(b0 + b1 * data.actuator_length) / gain
        damping = _loads(model, data) / BRAKING_TIME_S / gain
        self._hold: Numbers = np.where(actuators.are_servos, hold, 0.0)
        self._damping: Numbers = np.where(actuators.are_motors, damping, 0.0)
        self._actuators = actuators

    def control(self, velocity: Numbers) -> Numbers:
        """Compute the control for the next step.

        Args:
            velocity: `data.actuator_velocity`.
        """
        control = self._hold - self._damping * velocity
        return np.clip(control, self._actuators.least, self._actuators.most)


def _loads(model: mujoco.MjModel, data: mujoco.MjData) -> Numbers:
    """Compute the inertia that each actuator moves: force per acceleration of its length."""
    moments = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(
        moments,
        data.actuator_moment.ravel(),
        data.moment_rownnz,
        data.moment_rowadr,
        data.moment_colind.ravel(),
    )
    accelerations = np.zeros_like(moments)
    mujoco.mj_solveM(model, data, accelerations, moments)
    mobility = np.einsum("ij,ij->i", accelerations, moments)
    loads = np.zeros(model.nu)
    np.divide(1.0, mobility, out=loads, where=mobility > mujoco.mjMINVAL)
    return loads


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueLaw:
    """torque = kp (pos_target - position) + kd (vel_target - velocity) + feed_forward.

    Each field has shape (nu,), in the order of the actuators; units as in `PDFeedForward`.
    """

    pos_target: Numbers
    vel_target: Numbers
    feed_forward: Numbers
    kp: Numbers
    kd: Numbers


def has_gains(message: Any) -> bool:
    """Whether a `PDFeedForward` requests torques; without gains, its `u_mujoco` is used."""
    return bool(len(message.kp) or len(message.kd))


class JointTorques:
    """The joints driven by a model's actuators."""

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
        """Read the law of a `PDFeedForward`, or return the reason to reject the message.

        An empty `vel_target`, `feed_forward`, `kp` or `kd` counts as zero. `pos_target` may be
        empty only if `kp` is empty.
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
                return f"`{field}` has the length {values.size}, expected {count} (one per joint)"
            fault = out_of_limits(field, values)
            if fault is not None:
                return fault
            read[field] = values[order]
        return TorqueLaw(**read)

    def control(self, law: TorqueLaw, data: mujoco.MjData) -> Numbers:
        """Compute the controls that produce the law's torque at each joint in this state."""
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
        """Return the index of each actuator's joint in the message, or the reason to reject it."""
        if not names:
            return np.arange(len(self._joints))
        received, expected = Counter(names), Counter(self._names)
        if received != expected:
            differences = (
                f"{what} {list_names(found)}"
                for what, found in (
                    ("missing", expected - received),
                    ("not expected", received - expected),
                )
                if found
            )
            return (
                f"`joint_names` is {list_names(names)}, but the model drives "
                f"{list_names(self._names)}: {', '.join(differences)}"
            )
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
                return f"gains need joints, but the actuator `{name}` drives no hinge or slide"
            if not self._actuators.take_forces[index]:
                return f"gains need torques, but the actuator `{name}` takes no torque"
            if joint in self._joints[:index]:
                return f"two actuators drive the joint `{self._names[index]}`"
        return None
