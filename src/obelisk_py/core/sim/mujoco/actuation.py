"""Write the actuators' controls at each step: the newest control, or an action on old commands.

In: a `ControlInbox`, and whether its newest control is too old. Out: `data.ctrl`, written on the
thread that steps.
"""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco

from obelisk_py.core.sim.mujoco.actuators import Actuators, Brake, JointTorques, TorqueLaw
from obelisk_py.core.sim.mujoco.control import ControlInbox

__all__ = ["ControlWriter", "WhenStale"]


@dataclass(frozen=True, slots=True, kw_only=True)
class WhenStale:
    """The action on commands that are too old."""

    action: str
    """One of `obelisk_spec.components.STALE_ACTIONS`."""
    is_stale: Callable[[], bool]
    """Returns whether the newest command is too old; called before each step."""


class ControlWriter:
    """Writes the controls of one simulation."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        inbox: ControlInbox,
        when_stale: WhenStale | None,
    ) -> None:
        """Take what it reads from and writes to."""
        self._model = model
        self._data = data
        self._inbox = inbox
        self._when_stale = when_stale
        self._actuators = Actuators(model)
        self._torques = JointTorques(model)
        self._ctrl = data.ctrl
        self._applied: object = None
        self._brake: Brake | None = None

    def restart(self) -> None:
        """Forget the controls; `data.ctrl` stays until a new one is written."""
        self._inbox.clear()
        self._applied = None
        self._brake = None

    def write(self) -> bool:
        """Write the next step's control; returns whether the steps after it have the same one."""
        stale = self._when_stale
        if stale is not None and stale.is_stale() and stale.action != "hold":
            return self._write_safe(stale.action)
        self._brake = None
        control = self._inbox.newest
        if isinstance(control, TorqueLaw):
            self._ctrl[:] = self._torques.control(control, self._data)
            return False
        if control is not self._applied and control is not None:
            self._ctrl[:] = control
            self._applied = control
        return True

    def _write_safe(self, action: str) -> bool:
        if action == "zero":
            self._ctrl[:] = 0.0
            return True
        if self._brake is None:
            self._brake = Brake(self._actuators, self._model, self._data)
        self._ctrl[:] = self._brake.control(self._data.actuator_velocity)
        return False
