"""An ASGI application served by uvicorn on this host only, on a port that is taken beforehand."""

import socket
from typing import Final

import uvicorn
from starlette.types import ASGIApp

from obk_cli.errors import CommandFailedError

__all__ = ["HOST", "WebServer", "take_port"]

HOST: Final = "127.0.0.1"
END_S: Final = 2
"""For which open streams are waited for at the end [s]."""


def take_port(port: int) -> socket.socket:
    """A socket that listens on this host only.

    Args:
        port: 0: one that is free.

    Raises:
        CommandFailedError: it is taken, or not for this user.
    """
    taken = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    # Connections of a server that has just ended do not hold its port.
    taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        taken.bind((HOST, port))
        taken.listen()
    except OSError as error:
        taken.close()
        raise CommandFailedError(
            f"port {port} of {HOST} cannot be used: {error.strerror}",
            help="another `obk web` may have it; choose one with `--port`, 0 for any",
        ) from error
    return taken


class WebServer:
    """Serves until it is ended, or by Ctrl-C."""

    def __init__(self) -> None:
        """Nothing is served yet."""
        self._server: uvicorn.Server | None = None
        self._is_ended = False

    @property
    def is_ending(self) -> bool:
        """Whether streams without an end are to end now."""
        return self._is_ended or (self._server is not None and self._server.should_exit)

    def run(self, app: ASGIApp, taken: socket.socket) -> None:
        """Serve on a port, until the end."""
        self._server = uvicorn.Server(
            uvicorn.Config(
                app,
                log_config=None,
                access_log=False,
                lifespan="off",
                proxy_headers=False,
                server_header=False,
                ws="none",
                timeout_graceful_shutdown=END_S,
            )
        )
        self._server.should_exit = self._is_ended
        try:
            self._server.run(sockets=[taken])
        except KeyboardInterrupt:  # told once more by uvicorn, after the end
            return

    def end(self) -> None:
        """End soon; from any thread."""
        self._is_ended = True
        if self._server is not None:
            self._server.should_exit = True
