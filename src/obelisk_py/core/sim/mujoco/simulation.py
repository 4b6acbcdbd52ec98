"""Step a model and its state, without threads, ROS or wall clock.

In: controls through a `ControlInbox`. Out: the state in `data`, whose sensors always belong to the
state that was reached last, and MuJoCo's warnings as sentences with the simulation time and the
joint.
"""

from typing import Final

import mujoco

from obelisk_py.core.exceptions import ObeliskError
from obelisk_py.core.sim.mujoco.control import ControlInbox, ControlWriter, WhenStale
from obelisk_py.core.sim.mujoco.step_times import NS_PER_S, StepTime

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
    """The state is no longer finite; the message has the time and the joint."""


class Simulation:
    """Steps one model.

    mj_step leaves sensors that belong to the state before it. Here its second half comes first,
    then its first half, so that positions, velocities and the sensors of both belong to the time
    in `data.time`; the trajectory is that of mj_step to the bit. Accelerometers,
    forces and touches belong to the step that has just ended: those of the next depend on a control
    that is still to come.
    """

    def __init__(
        self, model: mujoco.MjModel, inbox: ControlInbox, when_stale: WhenStale | None = None
    ) -> None:
        """Take a compiled model; `reset` brings it to its start.

        Args:
            model: the model to step.
            inbox: provides its controls.
            when_stale: the action on old controls; None: they stay.
        """
        self.model = model
        self.data = mujoco.MjData(model)
        self.steps = 0
        """Steps since the reset."""
        self._writer = ControlWriter(model, self.data, inbox, when_stale)
        self._warnings = StepWarnings(model, self.data)
        self._split = int(model.opt.integrator) in _SPLIT_INTEGRATORS
        self._step_time = StepTime(self.step_s)
        self._start_ns = 0
        self.time_ns = 0
        """Simulation time [ns]; `data.time` is a sum of floats and drifts."""

    @property
    def step_s(self) -> float:
        """Simulation time of a step [s]."""
        return float(self.model.opt.timestep)

    @property
    def next_step_ns(self) -> int:
        """Simulation time that the next step takes [ns], so that they add up without drift."""
        return self._step_time.ns(self.steps + 1) - self._step_time.ns(self.steps)

    def reset(self, keyframe: str | None) -> None:
        """Go to a keyframe, with its control, or to the model's own start; controls are dropped."""
        self._writer.restart()
        _reset_state(self.model, self.data, keyframe)
        self.steps = 0
        self.time_ns = self._start_ns = round(self.data.time * NS_PER_S)
        self._warnings.restart()

    def advance(self, count: int = 1) -> tuple[str, ...]:
        """Take `count` steps with the newest control; where it depends on the state, with its own.

        Returns:
            Warnings of MuJoCo's that are new, as sentences.

        Raises:
            DivergenceError: the state is no longer finite.
        """
        if self._writer.write():
            self._step(count)
        else:
            self._step(1)
            for _ in range(count - 1):
                self._writer.write()
                self._step(1)
        return self._look_at_warnings() if self._warnings.changed() else ()

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
    """Watches the warning counters of one simulation."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Watch `data`, counting from its present counters."""
        self._model = model
        self._data = data
        self._stats = data.warning
        self._seen: list[int] = self._stats.number.tolist()

    def restart(self) -> None:
        """Mark the present counters as reported."""
        self._seen = self._stats.number.tolist()

    def changed(self) -> bool:
        """Whether a counter moved since it was last looked at; cheap, asked after each step."""
        return bool(self._stats.number.tolist() != self._seen)

    def fatal(self) -> str | None:
        """A sentence if the state has diverged, else None."""
        for kind, quantity in _FATAL.items():
            if self._stats[kind].number > self._seen[kind]:
                where = self._owner(kind, int(self._stats[kind].lastinfo))
                return (
                    f"the simulation diverged at {self._data.time:.4f} s: the {quantity} of "
                    f"{where} is not finite or larger than 1e10 "
                    "(a smaller time step, or weaker gains, may help)"
                )
        return None

    def tolerable(self) -> tuple[str, ...]:
        """Sentences about warnings seen for the first time; marks all as seen."""
        number = self._stats.number.tolist()
        fresh = tuple(
            f"MuJoCo, at {self._data.time:.4f} s: {text}"
            for kind, text in _TOLERABLE.items()
            if number[kind] > 0 and self._seen[kind] == 0
        )
        self._seen = number
        return fresh

    def _owner(self, kind: int, index: int) -> str:
        """Joint and body of an entry of qpos or of qvel."""
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
    """Put the state, and the control, to a keyframe or to the model's own start."""
    if keyframe is None:
        mujoco.mj_resetData(model, data)
    else:
        mujoco.mj_resetDataKeyframe(model, data, model.key(keyframe).id)
    mujoco.mj_forward(model, data)
