"""What MuJoCo counts as a warning while it steps, as sentences.

In: a model and its data after a step. Out: a sentence with the simulation time and the joint.
Never changes the state; that autoreset is off is the business of `model`.
"""

from typing import Final

import mujoco

__all__ = ["StepWarnings"]

_WARNING = mujoco.mjtWarning

_FATAL: Final = {
    int(_WARNING.mjWARN_BADQPOS): "position",
    int(_WARNING.mjWARN_BADQVEL): "velocity",
    int(_WARNING.mjWARN_BADQACC): "acceleration",
}
"""Warnings after which the state means nothing."""

_TOLERABLE: Final = {
    int(_WARNING.mjWARN_INERTIA): "the inertia matrix is nearly singular",
    int(_WARNING.mjWARN_CONTACTFULL): "the list of contacts is full",
    int(_WARNING.mjWARN_CNSTRFULL): "the list of constraints is full",
    int(_WARNING.mjWARN_BADCTRL): "a control is not a number",
}


class StepWarnings:
    """Watches the warning counters of one simulation."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Watch `data`, counting from its present counters."""
        self._model = model
        self._data = data
        self._stats = data.warning
        self._seen: list[int] = self._stats.number.tolist()

    def restart(self) -> None:
        """Take the present counters as seen."""
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
