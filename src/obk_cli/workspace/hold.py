"""Find a control law that holds a model's pose: choose setpoints and gains, then simulate them.

The input is a model file that compiles, the result a `Hold`. MuJoCo is imported for the first
model.

Source: https://mujoco.readthedocs.io/en/stable/computation/index.html (actuation model):
force = gain * ctrl + b0 + b1 * length + b2 * velocity, for a fixed gain and an affine bias.
"""

from collections import Counter, deque
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from obk_cli.errors import CommandFailedError
from obk_cli.scaffold.robot_model import HeldActuator, Hold
from obk_cli.workspace.model_reader import import_mujoco

__all__ = ["find_hold"]

_KEYFRAMES: Final = ("ic", "home")
"""Names of keyframes to hold, the best first; otherwise the first named keyframe is used."""
_BANDWIDTHS: Final = (20.0, 35.0, 50.0, 70.0, 100.0)
"""Bandwidths of the motors' joints, the softest first [rad/s]."""
_VELOCITY_GAIN: Final = 5.0
"""Commanded velocity of a velocity servo, relative to the distance from the pose [1/s]."""
_SMALL_DRIFT: Final = 0.01
"""If joints stay this close to their pose, no stiffer law is tried [rad or m]."""
_TRIAL_S: Final = 2.0
_LATE_PERIODS: Final = 2
"""Age of the state that the controller uses: one period for each node on the way."""
Numbers = NDArray[np.float64]


def find_hold(path: Path, period_s: float, *, shown: str) -> Hold:
    """Return the law for the best keyframe of a model, otherwise for its initial state.

    Args:
        path: a model that compiles.
        period_s: period of the controller [s].
        shown: the model's name in errors.

    Raises:
        CommandFailedError: the model has no actuators, a driven joint has no name, or the
            simulation diverges under every law.
    """
    mujoco = import_mujoco()
    mujoco.set_mju_user_warning(_drop)  # by default, warnings go to a file in the working folder
    model = mujoco.MjModel.from_xml_path(str(path))
    start = _Start.of(model)
    kinds = _Kinds.of(model, shown)
    softest, *stiffer = _BANDWIDTHS
    best = _tried(model, start, kinds, softest, period_s)
    for bandwidth in stiffer if kinds.has_motors else ():
        if best.drift < _SMALL_DRIFT:
            break
        hold = _tried(model, start, kinds, bandwidth, period_s)
        best = min(best, hold, key=lambda one: one.drift)
    if not np.isfinite(best.drift):
        raise CommandFailedError(
            f"{shown} cannot be simulated: it diverges within {_TRIAL_S:g} s"
            + (f" of its keyframe `{start.keyframe}`" if start.keyframe else ""),
            help='try a smaller time step, `integrator="implicitfast"`, or weaker actuators',
        )
    return best


def _drop(_text: str) -> None:
    """Ignore warnings: a law with which the model diverges is rejected anyway."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Start:
    """The state to hold."""

    keyframe: str
    number: int | None
    data: Any
    """`MjData` after a forward computation."""

    @classmethod
    def of(cls, model: Any) -> "_Start":
        mujoco = import_mujoco()
        named = {name: i for i in range(model.nkey) if (name := model.key(i).name)}
        chosen = next((name for name in _KEYFRAMES if name in named), next(iter(named), ""))
        data = mujoco.MjData(model)
        if chosen:
            mujoco.mj_resetDataKeyframe(model, data, named[chosen])
        mujoco.mj_forward(model, data)
        return cls(keyframe=chosen, number=named.get(chosen), data=data)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Kinds:
    """The type of each actuator, shape (nu,)."""

    joints: NDArray[np.intp]
    """The hinge or slide that it drives; -1 for none."""
    are_motors: NDArray[np.bool_]
    """Force is a multiple of the control, and no position servo drives the same joint."""
    are_velocity_servos: NDArray[np.bool_]
    """The same for a velocity as control."""
    are_position_servos: NDArray[np.bool_]
    share: Numbers
    """Fraction of a joint's gain for each of its motors."""

    @property
    def has_motors(self) -> bool:
        return bool(self.are_motors.any())

    @property
    def is_torque(self) -> bool:
        """Whether the simulator applies gains: every actuator is the only motor of its joint."""
        return bool(self.are_motors.all() and (self.share == 1.0).all())

    @classmethod
    def of(cls, model: Any, shown: str) -> "_Kinds":
        mujoco = import_mujoco()
        drives = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
        scalar = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
        is_driving = np.isin(model.actuator_trntype, drives) & (model.actuator_gear[:, 0] != 0)
        joints = np.where(is_driving, model.actuator_trnid[:, 0], -1).astype(np.intp)
        # Actuators without a joint index the last one here, and are excluded later.
        is_driving &= np.isin(model.jnt_type[joints], scalar) if model.njnt else False
        joints = np.where(is_driving, joints, -1)
        for number, joint in enumerate(joints):
            if joint >= 0 and not model.joint(joint).name:
                raise CommandFailedError(
                    f"{shown}: the joint that actuator {number} drives has no name",
                    help="name it: sensors and messages refer to joints by name",
                )
        fixed = (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED) & (
            model.actuator_gainprm[:, 0] != 0
        )
        affine = model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE
        unbiased = model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE
        follows = np.isin(
            model.actuator_dyntype,
            (
                mujoco.mjtDyn.mjDYN_NONE,
                mujoco.mjtDyn.mjDYN_FILTER,
                mujoco.mjtDyn.mjDYN_FILTEREXACT,
            ),
        )
        direct = model.actuator_dyntype == mujoco.mjtDyn.mjDYN_NONE
        servos = fixed & affine & follows
        position = servos & (model.actuator_biasprm[:, 1] != 0)
        velocity = servos & ~position & (model.actuator_biasprm[:, 2] != 0)
        free = (joints >= 0) & ~np.isin(joints, joints[position])
        motors = fixed & unbiased & direct & free
        counts = Counter(joints[motors].tolist())
        return cls(
            joints=joints,
            are_motors=motors,
            are_velocity_servos=velocity & free,
            are_position_servos=position,
            share=np.array([1.0 / counts.get(int(joint), 1) for joint in joints]),
        )


def _tried(model: Any, start: _Start, kinds: _Kinds, bandwidth: float, period_s: float) -> Hold:
    hold = Hold(
        keyframe=start.keyframe,
        actuators=tuple(_actuators(model, start, kinds, bandwidth)),
        is_torque=kinds.is_torque,
        drift=0.0,
    )
    return replace(hold, drift=_drift(model, start, kinds, hold, period_s))


def _actuators(model: Any, start: _Start, kinds: _Kinds, bandwidth: float) -> list[HeldActuator]:
    mujoco = import_mujoco()
    data = start.data
    setpoints = _setpoints(model, start, kinds)
    found = []
    for index, joint in enumerate(kinds.joints):
        actuator = HeldActuator(joint="", setpoint=_rounded(setpoints[index]))
        if joint >= 0:
            dof, gear = model.jnt_dofadr[joint], model.actuator_gear[index, 0]
            actuator = replace(
                actuator,
                joint=model.joint(joint).name,
                is_slide=model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE,
                pose=_rounded(data.qpos[model.jnt_qposadr[joint]]),
            )
            if kinds.are_motors[index]:
                inertia = _inertia(model, data, dof) * kinds.share[index]
                effort = gear * model.actuator_gainprm[index, 0]
                # The simulator itself converts joint torques to controls.
                scale = 1.0 if kinds.is_torque else effort
                actuator = replace(
                    actuator,
                    setpoint=_rounded(_load(model, data, dof) * kinds.share[index] / scale),
                    kp=_rounded(bandwidth**2 * inertia / scale),
                    kd=_rounded(2.0 * bandwidth * inertia / scale),
                )
            elif kinds.are_velocity_servos[index]:
                actuator = replace(actuator, kp=_rounded(_VELOCITY_GAIN * gear))
        found.append(actuator)
    return found


def _inertia(model: Any, data: Any, dof: int) -> float:
    """Inertia that a joint moves while the others are still [kg m2 or kg]."""
    unit, moved = np.zeros(model.nv), np.zeros(model.nv)
    unit[dof] = 1.0
    import_mujoco().mj_mulM(model, data, moved, unit)
    return float(moved[dof])


def _setpoints(model: Any, start: _Start, kinds: _Kinds) -> Numbers:
    """The keyframe's controls; otherwise those that keep each position servo in place."""
    data = start.data
    if start.number is not None and model.key_ctrl[start.number].any():
        return np.array(model.key_ctrl[start.number])
    b0, b1 = model.actuator_biasprm[:, 0], model.actuator_biasprm[:, 1]
    gain = np.where(kinds.are_position_servos, model.actuator_gainprm[:, 0], 1.0)
    still = -(b0 + b1 * data.actuator_length) / gain
    wanted = np.where(kinds.are_position_servos, still, 0.0)
    limited = model.actuator_ctrllimited.astype(bool)
    least, most = model.actuator_ctrlrange.T
    return np.where(limited, np.clip(wanted, least, most), wanted)


def _load(model: Any, data: Any, dof: int) -> float:
    """Gravity's force on a joint [N m or N]; zero if the ground may carry the robot."""
    root = model.body_rootid[model.dof_bodyid[dof]]
    first = model.body_jntadr[root]
    is_floating = first >= 0 and model.jnt_type[first] == import_mujoco().mjtJoint.mjJNT_FREE
    return 0.0 if is_floating else float(data.qfrc_bias[dof] - data.qfrc_passive[dof])


def _rounded(value: float) -> float:
    return float(f"{value:.4g}") + 0.0  # avoids -0.0


def _drift(model: Any, start: _Start, kinds: _Kinds, hold: Hold, period_s: float) -> float:
    """Largest distance from the pose in a simulation; infinite if it diverges."""
    mujoco = import_mujoco()
    driven = np.unique(kinds.joints[kinds.joints >= 0])
    address, dofs = model.jnt_qposadr[driven], model.jnt_dofadr[driven]
    if not driven.size:
        return 0.0
    place = np.searchsorted(driven, np.maximum(kinds.joints, driven[0]))
    pose, setpoint, kp, kd = (
        np.array([getattr(a, name) for a in hold.actuators])
        for name in ("pose", "setpoint", "kp", "kd")
    )
    scale = model.actuator_gear[:, 0] * model.actuator_gainprm[:, 0] if hold.is_torque else 1.0
    data = mujoco.MjData(model)
    if start.number is not None:
        mujoco.mj_resetDataKeyframe(model, data, start.number)
    held = data.qpos[address].copy()
    steps = 1 if hold.is_torque else max(1, round(period_s / model.opt.timestep))
    states: deque[tuple[Numbers, Numbers]] = deque(
        maxlen=1 if hold.is_torque else 1 + _LATE_PERIODS
    )
    warning = mujoco.mjtWarning
    bad = (warning.mjWARN_BADQPOS, warning.mjWARN_BADQVEL, warning.mjWARN_BADQACC)
    diverged = [int(one) for one in bad]
    largest = 0.0
    for _ in range(round(_TRIAL_S / model.opt.timestep / steps)):
        states.append((data.qpos[address].copy(), data.qvel[dofs].copy()))
        q, v = states[0]
        data.ctrl[:] = (setpoint + kp * (pose - q[place]) - kd * v[place]) / scale
        mujoco.mj_step(model, data, steps)
        largest = max(largest, float(np.abs(data.qpos[address] - held).max()))
        if not np.isfinite(largest) or data.warning.number[diverged].any():
            return float("inf")
    return largest
