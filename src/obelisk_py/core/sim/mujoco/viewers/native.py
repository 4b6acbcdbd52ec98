"""Show MuJoCo's own window: its passive viewer, which follows the states.

It needs a display. Closing the window closes the viewer, not the simulation.

Source: https://mujoco.readthedocs.io/en/stable/python.html#passive-viewer
"""

import os
import threading
import time
import warnings
from collections.abc import Sequence
from typing import Final

import mujoco.viewer

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.viewers.viewer_messages import Send, States

__all__ = ["run"]

_PERIOD_S: Final = 1 / 60
"""Time between two updates of the window [s]."""
_CLOSE_S: Final = 2.0
"""Timeout for the window to close [s]."""
_FIX: Final = "the `web` viewer (a page in the browser) works without one"


def run(states: States, send: Send, _arguments: Sequence[str]) -> None:
    """Show the window until the last state, or until the user closes it.

    Raises:
        ObeliskConfigError: no display is available.
    """
    _check_display()
    with mujoco.viewer.launch_passive(
        states.model, states.data, show_left_ui=False, show_right_ui=False
    ) as window:
        with window.lock():
            mujoco.mjv_defaultFreeCamera(states.model, window.cam)
        while not states.is_over and window.is_running():
            due_s = time.monotonic() + _PERIOD_S
            with window.lock():
                states.take_newest(0.0)
            window.sync()
            time.sleep(max(0.0, due_s - time.monotonic()))
    # Exiting while the window's thread is still rendering would crash it.
    for thread in threading.enumerate():
        if thread is not threading.current_thread():
            thread.join(_CLOSE_S)
    if not states.is_over:
        send("info", "the window was closed; the simulation continues")


def _check_display() -> None:
    display = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
    if not display:
        raise ObeliskConfigError(
            "the native viewer needs a display, and neither DISPLAY nor WAYLAND_DISPLAY is set; "
            f"{_FIX}"
        )
    # Otherwise the viewer would terminate the process with its own message.
    glfw = mujoco.viewer.glfw
    with warnings.catch_warnings(record=True):
        if not glfw.init():
            raise ObeliskConfigError(
                f"the native viewer needs a display, and `{display}` cannot be opened; {_FIX}"
            )
    glfw.terminate()
