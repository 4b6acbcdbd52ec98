"""The controls of the viewer's page (pause, step, reset, speed, push), and the robot's answers.

The buttons send requests to the robot, which carries them out or replies with the reason why it
cannot. The page shows what the robot reports, so it stays correct even if something else pauses the
simulation.
"""

import html
import math
from collections.abc import Callable
from typing import Any, Final

import mujoco
import numpy as np
import viser

from obelisk_py.core.sim.mujoco.viewers.viewer_requests import (
    LARGEST_FORCE_N,
    LONGEST_PUSH_S,
    PauseRequest,
    PushRequest,
    Report,
    Request,
    ResetRequest,
    SpeedRequest,
    StepRequest,
    keyframes_of,
    movable_bodies,
)

__all__ = ["SimulationControls"]

_START: Final = "initial state"
"""The choice that resets to the model's initial state."""
_SPEEDS: Final = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0)
_PUSH_S: Final = 0.1
"""Default duration of a push [s]."""
_WEIGHTS: Final = 0.5
"""Default force of a push, relative to the weight of the moving bodies."""
_NOT_STEPPING: Final = {
    "unconfigured": "is not configured",
    "inactive": "is inactive: the simulation starts when the robot is activated",
    "finalized": "has been shut down",
}


class SimulationControls:
    """The tab with the controls."""

    def __init__(
        self, gui: viser.GuiApi, model: mujoco.MjModel, send: Callable[[Request], None]
    ) -> None:
        """Add the controls to the current container of the page; they are disabled at first.

        Args:
            gui: the page's controls.
            model: the simulated model.
            send: sends a request to the robot; called on viser's threads.
        """
        self._send = send
        self._report: Report | None = None
        self._time_s = 0.0
        self._answer = ""
        self._status = gui.add_html("")
        self._pause = gui.add_button("Pause", icon=viser.Icon.PLAYER_PAUSE)
        self._step = gui.add_button(
            "Step", icon=viser.Icon.PLAYER_TRACK_NEXT, hint="One step of a paused simulation."
        )
        self._speed: Any = gui.add_dropdown(
            "Speed",
            _speeds(1.0),
            initial_value=_speed_label(1.0),
            hint="Simulated time relative to wall-clock time.",
        )
        self._keyframe = gui.add_dropdown("Keyframe", (*keyframes_of(model), _START))
        self._reset = gui.add_button("Reset", icon=viser.Icon.REFRESH)
        self._pause.on_click(self._on_pause)
        self._step.on_click(lambda _: send(StepRequest()))
        self._speed.on_update(self._on_speed)
        self._reset.on_click(self._on_reset)
        self._of_push: tuple[Any, ...] = ()
        bodies = movable_bodies(model)
        if bodies:
            with gui.add_folder("Push"):
                self._of_push = self._add_push(gui, model, bodies)
        self._show()

    def take(self, report: Report) -> None:
        """Show a report from the robot."""
        if report.answer:
            color = "inherit" if report.is_done else "#c92a2a"
            self._answer = f'<span style="color:{color}">{html.escape(report.answer)}</span>'
        if self._report is None or self._report.realtime_factor != report.realtime_factor:
            factor = report.realtime_factor
            self._speed.options = _speeds(factor)
            self._speed.value = _speed_label(factor)
        self._report = report
        self._show()

    def show_time(self, time_s: float) -> None:
        """Show the simulated time [s]."""
        if time_s != self._time_s:
            self._time_s = time_s
            self._show()

    def _add_push(
        self, gui: viser.GuiApi, model: mujoco.MjModel, bodies: tuple[str, ...]
    ) -> tuple[Any, ...]:
        self._body = gui.add_dropdown("Body", bodies)
        self._direction = gui.add_vector3(
            "Direction", (1.0, 0.0, 0.0), step=0.1, hint="In the world frame; length is ignored."
        )
        self._force = gui.add_number(
            "Force (N)", _default_force(model), min=0.0, max=LARGEST_FORCE_N
        )
        self._duration = gui.add_number(
            "Duration (s)", _PUSH_S, min=0.0, max=LONGEST_PUSH_S, step=0.01
        )
        push = gui.add_button("Push", icon=viser.Icon.HAND_FINGER)
        push.on_click(self._on_push)
        return (self._body, self._direction, self._force, self._duration, push)

    def _on_pause(self, _event: Any) -> None:
        if self._report is not None:
            self._send(PauseRequest(is_paused=not self._report.is_paused))

    def _on_speed(self, event: Any) -> None:
        # An event without a client means that `take`, not the user, has set the value.
        if event.client is not None:
            self._send(SpeedRequest(realtime_factor=float(self._speed.value.removesuffix("x"))))

    def _on_reset(self, _event: Any) -> None:
        name = self._keyframe.value
        self._send(ResetRequest(keyframe=None if name == _START else name))

    def _on_push(self, _event: Any) -> None:
        direction = np.array(self._direction.value, float)
        length = float(np.linalg.norm(direction)) or 1.0
        x, y, z = (direction / length * float(self._force.value)).tolist()
        self._send(
            PushRequest(
                body=self._body.value, force=(x, y, z), duration_s=float(self._duration.value)
            )
        )

    def _show(self) -> None:
        report = self._report
        is_stepping = report is not None and report.state == "active"
        is_paused = report is not None and report.is_paused
        _set(self._pause, "label", "Continue" if is_paused else "Pause")
        icon = viser.Icon.PLAYER_PLAY if is_paused else viser.Icon.PLAYER_PAUSE
        _set(self._pause, "icon", icon)
        for handle in (self._pause, self._reset, *self._of_push):
            _set(handle, "disabled", not is_stepping)
        _set(self._step, "disabled", not (is_stepping and is_paused))
        _set(self._speed, "disabled", report is None or report.realtime_factor == 0)
        self._status.content = (
            '<div style="padding:0 1em 0.5em 1em;font-size:0.9em">'
            f"<strong>{_standing(report)}</strong>, simulated time "
            f'<span style="font-variant-numeric:tabular-nums">{self._time_s:.3f}</span> s<br/>'
            f"{_reason(report) or self._answer or '&nbsp;'}</div>"
        )


def _set(handle: Any, name: str, value: Any) -> None:
    """Change a property of a control only if it differs: each change is sent to all pages."""
    if getattr(handle, name) != value:
        setattr(handle, name, value)


def _standing(report: Report | None) -> str:
    if report is None or report.state != "active":
        return "Not running"
    return "Paused" if report.is_paused else "Running"


def _reason(report: Report | None) -> str:
    """Why the controls are disabled; empty if they are not."""
    if report is None:
        return "waiting for the robot"
    if report.state == "active":
        return ""
    return f"the robot {_NOT_STEPPING.get(report.state, f'is {report.state}')}"


def _speed_label(factor: float) -> str:
    return f"{factor:g}x" if factor else "as fast as possible"


def _speeds(factor: float) -> tuple[str, ...]:
    """The speeds to choose from, which include the current one."""
    if factor == 0:
        return (_speed_label(factor),)
    return tuple(map(_speed_label, sorted({*_SPEEDS, factor})))


def _default_force(model: mujoco.MjModel) -> float:
    """A force, rounded to one significant digit, that moves the model visibly [N]."""
    moving = np.flatnonzero(model.body_weldid)
    gravity = float(np.linalg.norm(model.opt.gravity)) or 9.81
    force = _WEIGHTS * float(model.body_mass[moving].sum()) * gravity
    if not 0 < force < LARGEST_FORCE_N:
        return 1.0
    unit = 10.0 ** math.floor(math.log10(force))
    return float(round(force / unit) * unit)
