"""MuJoCo's own window: its passive viewer, which follows the states.

In: nothing but the states; it needs a display. Closing the window ends it, and not the simulation.

Source: https://mujoco.readthedocs.io/en/stable/python.html#passive-viewer
"""

import os
import time
from collections.abc import Sequence
from typing import Final

import mujoco.viewer

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.viewing.states import States
from obelisk_py.core.sim.mujoco.viewing.words import Tell

__all__ = ["look"]

_PERIOD_S: Final = 1 / 60
"""Between two states that the window gets [s]."""


def look(states: States, tell: Tell, _arguments: Sequence[str]) -> None:
    """Show the window until the states are over or it is closed.

    Raises:
        ObeliskConfigError: there is no display.
    """
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ObeliskConfigError(
            "the native viewer needs a display, and neither DISPLAY nor WAYLAND_DISPLAY is set; "
            "`web` (a page in the browser) needs none"
        )
    with mujoco.viewer.launch_passive(
        states.model, states.data, show_left_ui=False, show_right_ui=False
    ) as window:
        while not states.is_over and window.is_running():
            due_s = time.monotonic() + _PERIOD_S
            with window.lock():
                states.take_newest(0.0)
            window.sync()
            time.sleep(max(0.0, due_s - time.monotonic()))
    if not states.is_over:
        tell("info", "the window was closed; the simulation goes on")
