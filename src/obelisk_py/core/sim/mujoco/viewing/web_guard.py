"""Keeps the page of a simulation to itself: other pages in the same browser are refused.

The library that serves the page lets whoever asks look, under any name, and browsers let any page
open a WebSocket to this host. So every request is looked at before the library sees it.
"""

import http
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_spec.runtime_protocol import is_of_the_page, names_this_host

__all__ = ["own_page_only"]

Look = Callable[[ServerConnection, Request], Response | None]


@contextmanager
def own_page_only() -> Iterator[None]:
    """A server that viser starts while this is entered answers its own page only.

    Raises:
        ObeliskConfigError: it could not be kept so: this viser serves in another way.
    """
    serve = websockets.asyncio.server.serve
    is_kept = False

    def serve_guarded(*arguments: Any, process_request: Look, **options: Any) -> Any:
        nonlocal is_kept
        is_kept = True
        return serve(*arguments, process_request=_guarded(process_request), **options)

    # There is no option of viser's for it; this process has no other server.
    websockets.asyncio.server.serve = serve_guarded  # type: ignore[misc, assignment]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]
    if not is_kept:
        raise ObeliskConfigError(
            "the web viewer cannot keep other pages of the browser out with this version of "
            "`viser`; `pip install --upgrade obelisk-cli[viewer]` brings one that fits"
        )


def _guarded(look: Look) -> Look:
    def look_guarded(connection: ServerConnection, request: Request) -> Response | None:
        host, origin = request.headers.get("Host", ""), request.headers.get("Origin")
        if not names_this_host(host) or (origin and not is_of_the_page(origin, host)):
            return connection.respond(http.HTTPStatus.FORBIDDEN, "only the page itself may ask\n")
        return look(connection, request)

    return look_guarded
