"""Step a model and its state, without threads, ROS or a wall clock.

Controls come from a `ControlInbox`. The result is the state in `data`; its sensor values always
belong to the latest state. MuJoCo's warnings are returned as sentences with the simulated time and
the joint.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.exceptions import ObeliskError
from obelisk_py.core.sim.mujoco.control import ControlInbox, ControlWriter, WhenStale
from obelisk_py.core.sim.mujoco.step_times import NS_PER_S, StepTime, whole_steps

__all__ = ["DivergenceError", "Simulation", "StepWarnings"]

_SPLIT_INTEGRATORS: Final = frozenset(
    {
        int(mujoco.mjtIntegrator.mjINT_EULER),
        int(mujoco.mjtIntegrator.mjINT_IMPLICIT),
        int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST),
    }
)
"""Integrators for which mj_step1 and mj_step2 together are mj_step.

Source: https://mujoco.readthedocs.io/en/stable/programming/simulation.html (simulation loop).
"""
_WARNING = mujoco.mjtWarning
_FATAL: Final = {
    int(_WARNING.mjWARN_BADQPOS): "position",
    int(_WARNING.mjWARN_BADQVEL): "velocity",
    int(_WARNING.mjWARN_BADQACC): "acceleration",
}
"""Warnings after which the state is invalid."""
_TOLERABLE: Final = {
    int(_WARNING.mjWARN_INERTIA): "the inertia matrix is nearly singular",
    int(_WARNING.mjWARN_CONTACTFULL): "the list of contacts is full",
    int(_WARNING.mjWARN_CNSTRFULL): "the list of constraints is full",
    int(_WARNING.mjWARN_BADCTRL): "a control is not a number",
}


class DivergenceError(ObeliskError):
    """The state is no longer finite; the message gives the time and the joint."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Push:
    """A force and a torque on a body."""

    body: int
    wrench: NDArray[np.float64]
    """Force at the center of mass [N] and torque [N m], in the world frame, shape (6,)."""
    last_step: int


class Simulation:
    """Steps a model.

    mj_step leaves sensor values that belong to the previous state. Here, each step runs the second
    half of mj_step and then the first half. Positions, velocities and the sensors of both thus
    belong to `data.time`, and the trajectory is bitwise identical to that of mj_step.
    Accelerometers, forces and touch sensors belong to the step that has just ended, because their
    next values depend on a control that is not known yet.
    """

    def __init__(
        self, model: mujoco.MjModel, inbox: ControlInbox, when_stale: WhenStale | None = None
    ) -> None:
        """Create a simulation of a compiled model; call `reset` before the first step.

        Args:
            model: the model to step.
            inbox: provides the controls.
            when_stale: the response to stale controls; None keeps applying them.
        """
        self.model = model
        self.data = mujoco.MjData(model)
        self.steps = 0
        """Steps since the reset."""
        self._writer = ControlWriter(model, self.data, inbox, when_stale)
        self._warnings = StepWarnings(model, self.data)
        self._split = int(model.opt.integrator) in _SPLIT_INTEGRATORS
        self._step_time = StepTime(self.step_s)
        self._pushes: list[_Push] = []
        self._start_ns = 0
        self.time_ns = 0
        """Simulation time [ns]; unlike `data.time`, a sum of floats, it does not drift."""

    @property
    def step_s(self) -> float:
        """Simulation time per step [s]."""
        return float(self.model.opt.timestep)

    @property
    def next_step_ns(self) -> int:
        """Length of the next step in simulated time [ns]; the lengths add up without drift."""
        return self._step_time.ns(self.steps + 1) - self._step_time.ns(self.steps)

    def reset(self, keyframe: str | None) -> None:
        """Reset to a keyframe and its control, or to the model's initial state; drop controls."""
        self._writer.restart()
        self._pushes.clear()
        _reset_state(self.model, self.data, keyframe)
        self.steps = 0
        self.time_ns = self._start_ns = round(self.data.time * NS_PER_S)
        self._warnings.restart()

    def push(
        self,
        body: int,
        force: Sequence[float],
        duration_s: float,
        torque: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Push a body during the next steps; pushes of one body add up.

        Args:
            body: index of the body.
            force: at the center of mass, in the world frame [N], shape (3,).
            duration_s: simulated time, rounded up to steps [s].
            torque: in the world frame [N m], shape (3,).
        """
        wrench = np.array([*force, *torque], float)
        last_step = self.steps + whole_steps(duration_s, self.step_s)
        self._pushes.append(_Push(body=body, wrench=wrench, last_step=last_step))

    def advance(self, count: int = 1) -> tuple[str, ...]:
        """Take `count` steps with the latest control; a torque law is evaluated for each step.

        Returns:
            New MuJoCo warnings, as sentences.

        Raises:
            DivergenceError: the state is no longer finite.
        """
        if not self._pushes:
            self._advance(count)
        else:
            for _ in range(count):
                self._apply_pushes()
                self._advance(1)
        return self._look_at_warnings() if self._warnings.changed() else ()

    def _advance(self, count: int) -> None:
        if self._writer.write():
            self._step(count)
        else:
            self._step(1)
            for _ in range(count - 1):
                self._writer.write()
                self._step(1)

    def _apply_pushes(self) -> None:
        forces = self.data.xfrc_applied
        for push in self._pushes:
            forces[push.body] = 0.0
        self._pushes = [push for push in self._pushes if self.steps < push.last_step]
        for push in self._pushes:
            forces[push.body] += push.wrench

    def _step(self, count: int) -> None:
        if self._split:
            mujoco.mj_step2(self.model, self.data)
            if count > 1:
                mujoco.mj_step(self.model, self.data, count - 1)
        else:
            mujoco.mj_step(self.model, self.data, count)
        mujoco.mj_step1(self.model, self.data)
        self.steps += count
        self.time_ns = self._start_ns + self._step_time.ns(self.steps)

    def _look_at_warnings(self) -> tuple[str, ...]:
        fatal = self._warnings.fatal()
        if fatal is not None:
            raise DivergenceError(fatal)
        return self._warnings.tolerable()


class StepWarnings:
    """Watches the warning counters of a simulation."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Watch `data`, starting from its current counters."""
        self._model = model
        self._data = data
        self._stats = data.warning
        self._seen: list[int] = self._stats.number.tolist()

    def restart(self) -> None:
        """Mark the current counters as reported."""
        self._seen = self._stats.number.tolist()

    def changed(self) -> bool:
        """Whether a counter changed since the last check; cheap enough to call after each step."""
        return bool(self._stats.number.tolist() != self._seen)

    def fatal(self) -> str | None:
        """Return a message if the state has diverged, otherwise None."""
        for kind, quantity in _FATAL.items():
            if self._stats[kind].number > self._seen[kind]:
                where = self._owner(kind, int(self._stats[kind].lastinfo))
                return (
                    f"the simulation diverged at {self._data.time:.4f} s: the {quantity} of "
                    f"{where} is NaN, infinite or beyond 1e10 "
                    "(a smaller time step or lower gains may help)"
                )
        return None

    def tolerable(self) -> tuple[str, ...]:
        """Return messages for warnings that are new, and mark all as seen."""
        number = self._stats.number.tolist()
        fresh = tuple(
            f"MuJoCo, at {self._data.time:.4f} s: {text}"
            for kind, text in _TOLERABLE.items()
            if number[kind] > 0 and self._seen[kind] == 0
        )
        self._seen = number
        return fresh

    def _owner(self, kind: int, index: int) -> str:
        """Return the joint and body of an entry of qpos or qvel."""
        starts = (
            self._model.jnt_qposadr
            if kind == int(_WARNING.mjWARN_BADQPOS)
            else self._model.jnt_dofadr
        )
        joint = max(j for j in range(self._model.njnt) if starts[j] <= index)
        body = self._model.body(int(self._model.jnt_bodyid[joint])).name
        name = self._model.joint(joint).name or f"number {joint}"
        return f"joint `{name}` of body `{body}` (entry {index})"


def _reset_state(model: mujoco.MjModel, data: mujoco.MjData, keyframe: str | None) -> None:
    """Reset the state and control to a keyframe or to the model's initial state."""
    if keyframe is None:
        mujoco.mj_resetData(model, data)
    else:
        mujoco.mj_resetDataKeyframe(model, data, model.key(keyframe).id)
    mujoco.mj_forward(model, data)
