"""Decide whether a request may use a page: a trusted host, the page's own origin, the token.

Pure: a request's headers in, the reason to reject it or None out. Another page in the same browser
can send requests here, and can have its own name resolve to this host (DNS rebinding). The checks
are those of Jupyter Server.

Source: https://jupyter-server.readthedocs.io/en/latest/operators/security.html
"""

import secrets
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

__all__ = ["TOKEN", "WebRequest", "cookie_name", "new_token", "refusal"]

TOKEN: Final = "token"  # noqa: S105 - the parameter's name, no secret
"""The URL's parameter; the page's cookie holds the same value."""
_HOST_NAMES: Final = frozenset({"127.0.0.1", "localhost", "::1"})
"""Names of this host in the header `Host`."""


def names_this_host(host: str) -> bool:
    """Whether the header `Host` names this host, with any port.

    A foreign page in the same browser can make its own name resolve to this host (DNS rebinding),
    but the browser does not let it set this header.

    Args:
        host: the header's value; with `ssh -L` it has the port of the other end.
    """
    from urllib.parse import urlsplit  # nodes that serve no page start faster without it

    try:
        return urlsplit(f"//{host}").hostname in _HOST_NAMES
    except ValueError:
        return False


def is_of_the_page(origin: str, host: str) -> bool:
    """Whether a request comes from a page of the server that receives it.

    Source: https://developer.mozilla.org/docs/Web/HTTP/Headers/Origin

    Args:
        origin: value of the header `Origin`.
        host: value of the header `Host`.
    """
    return origin == f"http://{host}"


def cookie_name(port: int) -> str:
    """Name of the cookie with the token; ports of one host share their cookies."""
    return f"obk_{port}"


@dataclass(frozen=True, slots=True, kw_only=True)
class WebRequest:
    """The parts of a request that decide whether it is accepted."""

    method: str
    host: str
    """The `Host` header; empty if it is missing."""
    origin: str | None
    """The `Origin` header: the page that sends the request, if the browser names it."""
    tokens: tuple[str, ...]
    """From the cookie, the URL, and a header if the page reads one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """Why a request is rejected."""

    status: int
    """HTTP status code."""
    why: str


def new_token() -> str:
    """A random token of 192 bits."""
    return secrets.token_urlsafe(24)


def refusal(request: WebRequest, token: str, link: str) -> Refusal | None:
    """Why a request is rejected; None if it is accepted.

    Args:
        request: the request.
        token: the token of the page.
        link: where the user finds the page's URL, for the reason.
    """
    if not names_this_host(request.host):
        return Refusal(status=403, why="this page is for 127.0.0.1 and localhost only")
    changes = request.method not in ("GET", "HEAD")
    if (changes or request.origin) and not is_of_the_page(request.origin or "", request.host):
        return Refusal(status=403, why="only the page itself may send this request")
    if not _is_any(request.tokens, token):
        return Refusal(status=401, why=f"the token is missing or outdated: open {link}")
    return None


def _is_any(given: Iterable[str], token: str) -> bool:
    return any(secrets.compare_digest(one.encode(), token.encode()) for one in given)
