"""What a model's actuators make of a control: forces in, controls out, and controls that brake.

In: a compiled model and its state after mj_step1. Out: arrays of shape (nu,). Never writes to the
state.

Source: https://mujoco.readthedocs.io/en/stable/computation/index.html (actuation model):
force = gain * ctrl + b0 + b1 * length + b2 * velocity, for a fixed gain and an affine bias.
"""

from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

__all__ = ["BRAKING_TIME_S", "Actuators", "Brake"]

BRAKING_TIME_S: Final = 0.1
"""In this time a braked motor loses 63 % of its speed [s], where nothing else moves it.

Measured by the inertia that it feels with all others free: the least there can be, so that many
motors that brake together never overshoot. Joints that move as one take longer.
"""

_NONE: Final = int(mujoco.mjtDyn.mjDYN_NONE)
_FOLLOWING: Final = (
    _NONE,
    int(mujoco.mjtDyn.mjDYN_FILTER),
    int(mujoco.mjtDyn.mjDYN_FILTEREXACT),
)
"""Dynamics of actuators whose activation goes to the control, at once or after a while."""

Numbers = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Actuators:
    """The force laws of a model's actuators."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Read them from a compiled model."""
        self.gain: Numbers = model.actuator_gainprm[:, 0].copy()
        """Of those with a fixed gain, in the units of their force per unit of control."""
        self.bias: Numbers = model.actuator_biasprm[:, :3].copy()
        """b0, b1, b2 of those with an affine bias, shape (nu, 3)."""
        fixed = (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED) & (self.gain != 0)
        unbiased = model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE
        affine = model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE
        direct = model.actuator_dyntype == _NONE
        self.are_motors: Flags = fixed & unbiased & direct
        """Those whose force is a multiple of the control."""
        self.are_servos: Flags = fixed & affine & np.isin(model.actuator_dyntype, _FOLLOWING)
        """Those that go to a position or velocity."""
        self.take_forces: Flags = fixed & (unbiased | affine) & direct
        """Those with a control for every force."""
        self.bias[~affine] = 0.0
        limited = model.actuator_ctrllimited.astype(bool)
        self.least = np.where(limited, model.actuator_ctrlrange[:, 0], -np.inf)
        self.most = np.where(limited, model.actuator_ctrlrange[:, 1], np.inf)
        """The range of the controls."""

    def control_for(self, force: Numbers, length: Numbers, velocity: Numbers) -> Numbers:
        """The control with which each actuator that takes forces has that one.

        Args:
            force: of each actuator.
            length: `data.actuator_length`.
            velocity: `data.actuator_velocity`.
        """
        b0, b1, b2 = self.bias.T
        gain = np.where(self.take_forces, self.gain, 1.0)
        control: Numbers = (force - b0 - b1 * length - b2 * velocity) / gain
        return control


class Brake:
    """Stops a model by its actuators, from the state in which it is made.

    A motor's force is opposed to its velocity; a position servo holds the position where it is now,
    a velocity servo the velocity zero; every other actuator gets zero.
    """

    def __init__(self, actuators: Actuators, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Look at how heavy each motor's load is, and at where each servo is."""
        b0, b1, _ = actuators.bias.T
        gain = np.where(actuators.gain == 0, 1.0, actuators.gain)
        hold = -(b0 + b1 * data.actuator_length) / gain
        damping = _loads(model, data) / BRAKING_TIME_S / gain
        self._hold: Numbers = np.where(actuators.are_servos, hold, 0.0)
        self._damping: Numbers = np.where(actuators.are_motors, damping, 0.0)
        self._actuators = actuators

    def control(self, velocity: Numbers) -> Numbers:
        """The control of the next step.

        Args:
            velocity: `data.actuator_velocity`.
        """
        control = self._hold - self._damping * velocity
        return np.clip(control, self._actuators.least, self._actuators.most)


def _loads(model: mujoco.MjModel, data: mujoco.MjData) -> Numbers:
    """The inertia that each actuator has to move, force over acceleration of its length."""
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
