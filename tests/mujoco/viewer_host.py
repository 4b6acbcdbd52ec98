"""A simulation without ROS that offers viewers the same as the robot does."""

from dataclasses import dataclass, field

import mujoco

from obelisk_py.core.sim.mujoco.control import ControlInbox
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.step_queue import StepQueue, StepResult
from obelisk_py.core.sim.mujoco.viewers.processes import ViewerHost
from obelisk_py.core.sim.mujoco.viewers.viewer_controls import ViewerControls
from obelisk_py.core.sim.mujoco.viewers.viewer_requests import Report
from obelisk_spec.page_access import new_token

__all__ = ["Viewable"]


@dataclass
class Viewable:
    """A simulation that runs requests at once; the tests step it."""

    model: mujoco.MjModel
    state: str = "active"
    factor: float = 1.0
    token: str = field(default_factory=new_token)
    log: list[str] = field(default_factory=list)
    pages: list[str] = field(default_factory=list)
    messages: list[tuple[str, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        inbox = ControlInbox(field="u", size=self.model.nu, monotonic_s=lambda: 0.0)
        self.simulation = Simulation(self.model, inbox)
        self.simulation.reset(None)
        self.queue = StepQueue(is_stepping=lambda: self.state == "active", is_immediate=True)
        self.controls = ViewerControls(
            simulation=self.simulation,
            queue=self.queue,
            step=self._step,
            reset=self._reset,
            set_speed=self._set_speed,
            report=self._report,
            log=self.log.append,
        )
        self.host = ViewerHost(
            controls=self.controls,
            name="arm",
            token=self.token,
            notify=lambda *message: self.messages.append(message),
            show_page=self.pages.append,
        )

    def _step(self) -> StepResult:
        self.simulation.advance()
        return StepResult(is_done=True, text="")

    def _reset(self, keyframe: str | None) -> StepResult:
        self.simulation.reset(keyframe)
        return StepResult(is_done=True, text="")

    def _set_speed(self, factor: float) -> StepResult:
        self.factor = factor
        return StepResult(is_done=True, text="")

    def _report(self) -> Report:
        return Report(state=self.state, is_paused=self.queue.is_paused, realtime_factor=self.factor)
