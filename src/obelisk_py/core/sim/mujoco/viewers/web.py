"""Show a page in the browser: mjviser, which renders a MuJoCo model with viser, on this host only.

The page is at `http://127.0.0.1:PORT`; port 0 selects a free one near 8080. The page contains
everything that it needs and loads nothing from elsewhere. Viser responds to any client and any host
name, and browsers let any page open a WebSocket to this host. So every request is checked first.

Source: https://github.com/mujocolab/mjviser, https://viser.studio
"""

import http
import os
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

import viser
import websockets.asyncio.server
from mjviser import ViserMujocoScene
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.viewers.viewer_messages import Notify, States
from obelisk_spec.runtime_protocol import is_of_the_page, names_this_host

__all__ = ["own_page_only", "run"]

Look = Callable[[ServerConnection, Request], Response | None]
_HOST: Final = "127.0.0.1"
_PORT: Final = 8080
_PERIOD_S: Final = 1 / 30
"""Time between two updates of the page [s]."""
_DISTANCE: Final = 1.5
"""Distance of the camera in extents of the model, as in MuJoCo's own viewer."""
_WAIT_S: Final = 0.1
"""Maximum delay of a setting changed in the page while nothing moves [s]."""


@contextmanager
def own_page_only() -> Iterator[None]:
    """Make a server that viser starts while this is entered respond only to its own page.

    Raises:
        ObeliskConfigError: this version of viser serves requests in another way.
    """
    serve = websockets.asyncio.server.serve
    is_kept = False

    def serve_guarded(*arguments: Any, process_request: Look, **options: Any) -> Any:
        nonlocal is_kept
        is_kept = True
        return serve(*arguments, process_request=_guarded(process_request), **options)

    # Viser has no option for this, and this process has no other server.
    websockets.asyncio.server.serve = serve_guarded  # type: ignore[misc, assignment]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]
    if not is_kept:
        raise ObeliskConfigError(
            "the web viewer cannot block requests from other browser pages with this version of "
            "`viser`; `pip install --upgrade obelisk-cli[viewer]` installs a supported one"
        )


def _guarded(look: Look) -> Look:
    def look_guarded(connection: ServerConnection, request: Request) -> Response | None:
        host, origin = request.headers.get("Host", ""), request.headers.get("Origin")
        if not names_this_host(host) or (origin and not is_of_the_page(origin, host)):
            return connection.respond(http.HTTPStatus.FORBIDDEN, "only the page itself may ask\n")
        return look(connection, request)

    return look_guarded


class _Server(viser.ViserServer):
    """A server whose page cannot be shared with other machines."""

    def request_share_url(self, verbose: bool = True) -> None:
        """Reject the request."""


def run(states: States, notify: Notify, arguments: Sequence[str]) -> None:
    """Serve the page until the last state.

    Raises:
        ObeliskConfigError: the port is in use, or viser cannot block other pages.
    """
    (port,) = map(int, arguments)
    # This variable would override the requested port.
    os.environ.pop("_VISER_PORT_OVERRIDE", None)
    if port:
        _check_port_is_free(port)
    with own_page_only():
        server = _Server(host=_HOST, port=port or _PORT, verbose=False)
    scene = _scene(server, states)
    notify("info", f"the simulation is shown at http://{_HOST}:{server.get_port()}")
    while not states.is_over:
        due_s = time.monotonic() + _PERIOD_S
        if states.take_newest(_WAIT_S) or scene.needs_update:
            scene.needs_update = False
            scene.update_from_mjdata(states.data)
            time.sleep(max(0.0, due_s - time.monotonic()))
    server.stop()


def _scene(server: viser.ViserServer, states: States) -> ViserMujocoScene:
    """Create the page's scene at the current state of `states`, with its controls."""
    server.gui.configure_theme(show_share_button=False, show_logo=False)
    scene = ViserMujocoScene(server, states.model, num_envs=1)
    # This thread, the only one that touches the data, applies changes made in the page.
    scene.set_refresh_handler(_nothing)
    view = states.model.vis.global_
    scene.create_visualization_gui(
        camera_distance=_DISTANCE * states.model.stat.extent,
        camera_azimuth=view.azimuth,
        camera_elevation=-view.elevation,
    )
    scene.update_from_mjdata(states.data)
    return scene


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
