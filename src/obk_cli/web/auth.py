"""Decide whether a request may use the page: a trusted host, the page's own origin, the token.

Pure: a request's headers in, the reason to reject it or None out. Another page in the same browser
can send requests here, and can have its own name resolve to this host (DNS rebinding). The checks
are those of Jupyter Server.

Source: https://jupyter-server.readthedocs.io/en/latest/operators/security.html
"""

import secrets
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from obelisk_spec.runtime_protocol import is_of_the_page, names_this_host

__all__ = ["HEADERS", "Refusal", "WebRequest", "new_token", "refusal"]

HEADERS: Final = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
        "img-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Headers of every response: the page runs and fetches only content of this server."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WebRequest:
    """The parts of a request that decide whether it is accepted."""

    method: str
    host: str
    """The `Host` header; empty if it is missing."""
    origin: str | None
    """The `Origin` header: the page that sends the request, if the browser names it."""
    tokens: tuple[str, ...]
    """From the cookie, the `X-Obk-Token` header and the URL."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """Why a request is rejected."""

    status: int
    """HTTP status code."""
    why: str


def new_token() -> str:
    """A random token of 192 bits."""
    return secrets.token_urlsafe(24)


def refusal(request: WebRequest, token: str) -> Refusal | None:
    """Why a request is rejected; None if it is accepted."""
    if not names_this_host(request.host):
        return Refusal(status=403, why="this page is for 127.0.0.1 and localhost only")
    changes = request.method not in ("GET", "HEAD")
    if (changes or request.origin) and not is_of_the_page(request.origin or "", request.host):
        return Refusal(status=403, why="only the page itself may send this request")
    if not _is_any(request.tokens, token):
        return Refusal(
            status=401, why="the token is missing or outdated: open the URL that `obk web` printed"
        )
    return None


def _is_any(given: Iterable[str], token: str) -> bool:
    return any(secrets.compare_digest(one.encode(), token.encode()) for one in given)
