"""Show a page in the browser: mjviser, which renders a MuJoCo model with viser, on this host only.

The page is at `http://127.0.0.1:PORT`; port 0 selects a free one near 8080. It opens only with the
token in its link (`web_access`). It contains everything that it needs and loads nothing from
elsewhere.

Source: https://github.com/mujocolab/mjviser, https://viser.studio
"""

import os
import socket
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final

import mujoco
import viser
from mjviser import ViserMujocoScene

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.viewers.viewer_messages import TOKEN_VARIABLE, Send, States
from obelisk_py.core.sim.mujoco.viewers.viewer_requests import Request, read_report, request_text
from obelisk_py.core.sim.mujoco.viewers.web_access import only_with_token
from obelisk_py.core.sim.mujoco.viewers.web_camera import PageCamera
from obelisk_py.core.sim.mujoco.viewers.web_commands import command_units, commands_table
from obelisk_py.core.sim.mujoco.viewers.web_controls import SimulationControls
from obelisk_spec.page_access import TOKEN

__all__ = ["page_title", "run"]

_HOST: Final = "127.0.0.1"
_PORT: Final = 8080
_PERIOD_S: Final = 1 / 30
"""Time between two updates of the page [s]."""
_TEXT_PERIOD_S: Final = 0.1
"""Time between two updates of texts in the page [s]."""
_WAIT_S: Final = 0.1
"""Maximum delay of a setting changed in the page while nothing moves [s]."""
_UNNAMED: Final = "MuJoCo Model"
"""MuJoCo's name for a model without one."""


class _Server(viser.ViserServer):
    """A server whose page cannot be shared with other machines."""

    def request_share_url(self, verbose: bool = True) -> None:
        """Reject the request."""


def run(states: States, send: Send, arguments: Sequence[str]) -> None:
    """Serve the page until the last state.

    Raises:
        ObeliskConfigError: the port is in use, or viser cannot keep others out.
    """
    port, robot = int(arguments[0]), arguments[1]
    token = os.environ[TOKEN_VARIABLE]
    # This variable would override the requested port.
    os.environ.pop("_VISER_PORT_OVERRIDE", None)
    if port:
        _check_port_is_free(port)
    title = page_title(states.model, robot)
    with only_with_token(token, f"{title} - obk"):
        server = _Server(host=_HOST, port=port or _PORT, verbose=False)

    def ask(request: Request) -> None:
        # A robot that has ended, or takes no messages, cannot answer.
        with suppress(OSError):
            send("request", request_text(request))

    page = _Page(server, states, title, ask)
    send("page", f"http://{_HOST}:{server.get_port()}/?{TOKEN}={token}")
    while not states.is_over:
        due_s = time.monotonic() + _PERIOD_S
        if page.update(is_new=states.take_newest(_WAIT_S)):
            time.sleep(max(0.0, due_s - time.monotonic()))
    server.stop()


def page_title(model: mujoco.MjModel, robot: str) -> str:
    """The name of a model, or of the robot if the model has none."""
    name = bytes(model.names).split(b"\0", 1)[0].decode(errors="replace")
    return robot if name in ("", _UNNAMED) else name


class _Page:
    """The page: the scene, its controls, and the texts that change with the state."""

    def __init__(
        self,
        server: viser.ViserServer,
        states: States,
        title: str,
        ask: Callable[[Request], None],
    ) -> None:
        self._states = states
        gui = server.gui
        gui.configure_theme(show_share_button=False, show_logo=False, control_width="large")
        gui.set_panel_label(title)
        self._scene = scene = ViserMujocoScene(server, states.model, num_envs=1)
        # This thread, the only one that touches the data, applies changes made in the page.
        scene.set_refresh_handler(_nothing)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Simulation", icon=viser.Icon.PLAYER_PLAY):
            self._controls = SimulationControls(gui, states.model, ask)
            with gui.add_folder("Commands"):
                self._shows_commands = gui.add_checkbox(
                    "Show", initial_value=False, hint="What the actuators receive."
                )
                self._commands = gui.add_html("", visible=False)
        with tabs.add_tab("Scene", icon=viser.Icon.VIDEO):
            PageCamera(server, scene, states.data)
        with tabs.add_tab("Overlays", icon=viser.Icon.EYE):
            scene.create_overlay_gui()
        with tabs.add_tab("Groups", icon=viser.Icon.LAYERS_INTERSECT):
            scene.create_groups_gui()
        self._units = command_units(states.model)
        self._text_due_s = 0.0
        scene.update_from_mjdata(states.data)

    def update(self, *, is_new: bool) -> bool:
        """Show what has changed; returns whether the scene was drawn."""
        for text in self._states.reports:
            self._controls.take(read_report(text))
        self._states.reports.clear()
        if time.monotonic() >= self._text_due_s:
            self._text_due_s = time.monotonic() + _TEXT_PERIOD_S
            self._show_texts()
        if not is_new and not self._scene.needs_update:
            return False
        # The scene has no property for this flag; without overlays it draws faster.
        has_push = bool(self._states.data.xfrc_applied.any())
        self._scene._mjv_option.flags[mujoco.mjtVisFlag.mjVIS_PERTFORCE] = has_push
        self._scene.needs_update = False
        self._scene.update_from_mjdata(self._states.data)
        return True

    def _show_texts(self) -> None:
        data, is_shown = self._states.data, self._shows_commands.value
        self._controls.show_time(data.time)
        if self._commands.visible != is_shown:
            self._commands.visible = is_shown
        if is_shown:
            table = commands_table(self._states.model, data, self._units)
            if table != self._commands.content:
                self._commands.content = table


def _check_port_is_free(port: int) -> None:
    # Viser would silently use the next free port.
    with socket.socket() as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((_HOST, port))
        except OSError as error:
            raise ObeliskConfigError(
                f"the web viewer cannot use port {port} (`viewer_port`): {error.strerror}; "
                "choose another port, or 0 for a free one"
            ) from error


def _nothing() -> None:
    """Do nothing; the next turn of the loop applies the change."""
