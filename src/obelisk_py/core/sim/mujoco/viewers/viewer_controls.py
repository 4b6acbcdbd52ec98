"""Carry out what a viewer requests, between two steps of the simulation, and log it.

The requests use the same actions as the services `~/pause`, `~/step` and `~/reset` and the ROS
parameter `realtime_factor`. Everything that is done is logged, so that a log explains why a robot
stood still or fell.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import assert_never

from obelisk_py.core.exceptions import ObeliskError
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.step_queue import StepQueue, StepResult
from obelisk_py.core.sim.mujoco.step_times import NS_PER_S
from obelisk_py.core.sim.mujoco.viewers.viewer_requests import (
    PauseRequest,
    PushRequest,
    Report,
    Request,
    RequestError,
    ResetRequest,
    SpeedRequest,
    StepRequest,
    read_request,
)

__all__ = ["ViewerControls"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewerControls:
    """The actions of a simulated robot that a viewer may request; for threads that may wait."""

    simulation: Simulation
    queue: StepQueue
    """Runs the actions on the stepping thread."""
    step: Callable[[], StepResult]
    """Takes one step; called on the stepping thread."""
    reset: Callable[[str | None], StepResult]
    """Resets to a keyframe, or to the model's initial state; called on the stepping thread."""
    set_speed: Callable[[float], StepResult]
    """Sets the ROS parameter `realtime_factor`."""
    report: Callable[[], Report]
    """Returns the robot's state."""
    log: Callable[[str], None]

    def answer(self, text: str) -> Report:
        """Carry out a request, and report the result or why it is impossible now.

        Args:
            text: from the viewer, unchecked.
        """
        try:
            request = read_request(text, self.simulation.model)
        except RequestError as error:
            return replace(self.report(), answer=str(error), is_done=False)
        try:
            result = self._do(request)
        except ObeliskError as error:  # the simulation diverges in a step, which fails the robot
            return replace(self.report(), answer=str(error), is_done=False)
        if not result.is_done:
            return replace(self.report(), answer=result.text, is_done=False)
        done, when = _done(request), f"at {self.simulation.time_ns / NS_PER_S:.12g} s"
        self.log(f"{done} from the viewer, {when}{_detail(request)}")
        return replace(self.report(), answer=done)

    def _do(self, request: Request) -> StepResult:
        match request:
            case PauseRequest(is_paused=is_paused):
                return self.queue.ask_pause(is_paused)
            case StepRequest():
                return self.queue.ask_step(self.step)
            case ResetRequest(keyframe=keyframe):
                return self.queue.ask(partial(self.reset, keyframe))
            case SpeedRequest(realtime_factor=factor):
                return self.set_speed(factor)
            case PushRequest():
                return self.queue.ask(partial(self._push, request))
            case _:
                assert_never(request)

    def _push(self, request: PushRequest) -> StepResult:
        body = self.simulation.model.body(request.body).id
        self.simulation.push(body, request.force, request.duration_s)
        return StepResult(is_done=True, text=str(request))


def _done(request: Request) -> str:
    match request:
        case PauseRequest(is_paused=is_paused):
            return f"simulation {'paused' if is_paused else 'continued'}"
        case StepRequest():
            return "one step"
        case ResetRequest(keyframe=None):
            return "reset to the initial state"
        case ResetRequest(keyframe=keyframe):
            return f"reset to the keyframe {keyframe}"
        case SpeedRequest(realtime_factor=factor):
            return f"speed {factor:g}"
        case PushRequest():
            return str(request)
        case _:
            assert_never(request)


def _detail(request: Request) -> str:
    if not isinstance(request, PushRequest):
        return ""
    vector = ", ".join(f"{number:.4g}" for number in request.force)
    return f", force ({vector}) N in the world frame"
