"""Who may use the page: browsers of this host that were given its address, and nobody they visit.

In: what a request says of itself. Out: why it is refused, or None. A foreign page in the same
browser can send requests here, and can have its own name point here; so the name that was asked
for, the page that asks and a token that only the terminal tells are looked at.
"""

import secrets
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from obelisk_spec.runtime_protocol import is_of_the_page, names_this_host

__all__ = ["HEADERS", "Refusal", "Ticket", "WebRequest", "new_token", "refusal"]

ROOT: Final = 0
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
"""Of every answer: nothing is run or fetched but what comes from here."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WebRequest:
    """What a request says of itself."""

    method: str
    host: str
    """The header's text; empty without one."""
    origin: str | None
    """The header's text: the page that asks, where the browser tells."""
    tokens: tuple[str, ...]
    """As given by cookie, header or address."""
    ticket: str = ""
    """As given by the address."""
    user: int | None = None
    """Whose process has sent it, where there is a ticket; None: that is not told."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ticket:
    """What stands in for the token in an address that obk opens itself.

    A browser is started with it, and how programs are started all users of a host can read.
    """

    word: str
    user: int
    """Who may use it, beside root."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """Why a request gets nothing."""

    status: int
    """Of HTTP."""
    why: str


def new_token() -> str:
    """One that nobody guesses."""
    return secrets.token_urlsafe(24)


def refusal(request: WebRequest, token: str, ticket: Ticket | None = None) -> Refusal | None:
    """Why a request is refused; None: it is not.

    Args:
        request: what it says.
        token: that it has to know.
        ticket: that does too; None: there is none.
    """
    if not names_this_host(request.host):
        return Refusal(status=403, why="this page is for 127.0.0.1 and localhost only")
    changes = request.method not in ("GET", "HEAD")
    if (changes or request.origin) and not is_of_the_page(request.origin or "", request.host):
        return Refusal(status=403, why="only the page itself may ask this")
    if not _is_any(request.tokens, token) and not _has_ticket(request, ticket):
        return Refusal(
            status=401, why="the token is missing or old: open the address that `obk web` printed"
        )
    return None


def _has_ticket(request: WebRequest, ticket: Ticket | None) -> bool:
    if ticket is None or request.user not in (ticket.user, ROOT):
        return False
    return _is_any((request.ticket,), ticket.word)


def _is_any(given: Iterable[str], token: str) -> bool:
    return any(secrets.compare_digest(one.encode(), token.encode()) for one in given)
