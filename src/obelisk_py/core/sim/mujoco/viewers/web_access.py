"""Restrict the viewer's page to those who have its link, and give it its title.

Viser responds to any client and any host name, and browsers let any page open a WebSocket to this
host. So every request, including one for a WebSocket, is checked first, as in `obk web`: the name
of the host, the origin, and the token, which is in the page's link and afterwards in a cookie.
"""

import html
import http
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.cookies import CookieError, SimpleCookie
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit

import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_spec.page_access import TOKEN, WebRequest, cookie_name, refusal

__all__ = ["only_with_token"]

Look = Callable[[ServerConnection, Request], Response | None]
_LINK: Final = "the link that `obk launch` and `obk ps` show"
_HEADERS: Final = {
    "Content-Security-Policy": "frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
"""Headers of every response; no other page may frame this one and hijack its clicks."""
_TITLE: Final = b"<title>Viser</title>"
_FORGET: Final = "<script>history.replaceState(null, '', location.pathname)</script>"
"""The token is a cookie by now, so remove it from the URL and the history."""


@contextmanager
def only_with_token(token: str, title: str) -> Iterator[None]:
    """Make servers that viser starts in the `with` block require the token in each request.

    Args:
        token: the token in the page's link.
        title: title of the page.

    Raises:
        ObeliskConfigError: this version of viser serves requests in another way.
    """
    serve = websockets.asyncio.server.serve
    is_kept = False

    def serve_guarded(*arguments: Any, process_request: Look, **options: Any) -> Any:
        nonlocal is_kept
        is_kept = True
        guarded = _guarded(process_request, token, title)
        return serve(*arguments, process_request=guarded, **options)

    # Viser has no option for this, and this process has no other server.
    websockets.asyncio.server.serve = serve_guarded  # type: ignore[misc, assignment]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]
    if not is_kept:
        raise ObeliskConfigError(
            "the web viewer cannot keep other users and pages out with this version of "
            "`viser`; `pip install --upgrade obelisk-cli[viewer]` installs a supported one"
        )


def _guarded(look: Look, token: str, title: str) -> Look:
    head = f"<title>{html.escape(title)}</title>{_FORGET}".encode()

    def look_guarded(connection: ServerConnection, request: Request) -> Response | None:
        cookie = cookie_name(connection.local_address[1])
        why = refusal(_web_request(request, cookie), token, _LINK)
        if why is not None:
            response = connection.respond(http.HTTPStatus.FORBIDDEN, f"{why.why}\n")
            response.headers.update(_HEADERS)
            return response
        # The page is changed below.
        request.headers.pop("Accept-Encoding", None)
        answer = look(connection, request)
        if answer is not None and _TITLE in answer.body:
            answer.body = bytes(answer.body).replace(_TITLE, head, 1)
            del answer.headers["Content-Length"]
            answer.headers["Content-Length"] = str(len(answer.body))
            answer.headers["Set-Cookie"] = f"{cookie}={token}; HttpOnly; Path=/; SameSite=Strict"
        if answer is not None:
            answer.headers.update(_HEADERS)
        return answer

    return look_guarded


def _web_request(request: Request, cookie: str) -> WebRequest:
    # websockets accepts no method but GET.
    return WebRequest(
        method="GET",
        host=request.headers.get("Host", ""),
        origin=request.headers.get("Origin"),
        tokens=(
            *_cookie_values(request.headers.get_all("Cookie"), cookie),
            *parse_qs(urlsplit(request.path).query).get(TOKEN, ()),
        ),
    )


def _cookie_values(headers: list[str], name: str) -> Iterator[str]:
    for header in headers:
        try:
            found = SimpleCookie(header).get(name)
        except CookieError:
            continue
        if found is not None:
            yield found.value
