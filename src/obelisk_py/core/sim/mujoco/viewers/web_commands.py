"""Show the commands of a model's actuators as a table, with their units."""

import html
from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np

from obelisk_py.core.sim.mujoco.actuators import Actuators

__all__ = ["command_units", "commands_table"]

_TRANSMISSION: Final = mujoco.mjtTrn
_HINGE: Final = int(mujoco.mjtJoint.mjJNT_HINGE)
_SLIDE: Final = int(mujoco.mjtJoint.mjJNT_SLIDE)
_JOINTS: Final = (int(_TRANSMISSION.mjTRN_JOINT), int(_TRANSMISSION.mjTRN_JOINTINPARENT))
_UNITS: Final = {_HINGE: ("N m", "rad", "rad/s"), _SLIDE: ("N", "m", "m/s")}
"""Units of force, position and velocity of a joint."""


def command_units(model: mujoco.MjModel) -> tuple[str, ...]:
    """The unit of each actuator's command; empty if its force law does not imply one."""
    actuators = Actuators(model)
    return tuple(_unit(model, actuators, number) for number in range(model.nu))


def _unit(model: mujoco.MjModel, actuators: Actuators, number: int) -> str:
    if model.actuator_trntype[number] not in _JOINTS:
        return ""
    joint = int(model.actuator_trnid[number, 0])
    if int(model.jnt_type[joint]) not in _UNITS:
        return ""
    force, position, velocity = _UNITS[int(model.jnt_type[joint])]
    gain = actuators.gain[number]
    _, of_length, of_velocity = actuators.bias[number]
    if actuators.are_motors[number]:
        return force if gain == 1.0 else ""
    if actuators.are_servos[number] and of_length == -gain:
        return position
    if actuators.are_servos[number] and of_length == 0.0 and of_velocity == -gain:
        return velocity
    return ""


def commands_table(model: mujoco.MjModel, data: mujoco.MjData, units: Sequence[str]) -> str:
    """The commands in `data.ctrl` as an HTML table, in the order of the model.

    A command outside the limits of its actuator is shown with the value that MuJoCo applies.

    Args:
        model: the model.
        data: its state.
        units: as from `command_units`.
    """
    if model.nu == 0:
        return "<p>The model has no actuators.</p>"
    is_limited = model.actuator_ctrllimited.astype(bool)
    low = np.where(is_limited, model.actuator_ctrlrange[:, 0], -np.inf)
    high = np.where(is_limited, model.actuator_ctrlrange[:, 1], np.inf)
    applied = np.clip(data.ctrl, low, high)
    rows = "".join(
        _row(
            model.actuator(number).name or f"actuator {number}",
            float(data.ctrl[number]),
            float(applied[number]),
            units[number],
        )
        for number in range(model.nu)
    )
    return (
        '<table style="width:100%;font-size:0.85em;border-spacing:0 2px;padding:0 1em">'
        '<tr style="text-align:left"><th>actuator</th><th style="text-align:right">command</th>'
        f"<th></th></tr>{rows}</table>"
    )


def _row(name: str, command: float, applied: float, unit: str) -> str:
    limited = "" if command == applied else f", limited to {applied:.3f}"
    return (
        f"<tr><td>{html.escape(name)}</td>"
        f'<td style="text-align:right;font-variant-numeric:tabular-nums">{command:.3f}{limited}'
        f'</td><td style="padding-left:0.5em">{unit}</td></tr>'
    )
