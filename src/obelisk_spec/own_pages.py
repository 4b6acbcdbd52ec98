"""Which requests come from a page of this host, and which from a page that its user visits.

In: the headers `Host` and `Origin` of a request. A foreign page in the same browser can send
requests to this host, and can have its own name point here (DNS rebinding); but a browser does not
let it choose these headers.

Source: https://developer.mozilla.org/docs/Web/HTTP/Headers/Origin
"""

from typing import Final
from urllib.parse import urlsplit

__all__ = ["is_of_the_page", "names_this_host"]

_NAMES: Final = frozenset({"127.0.0.1", "localhost", "::1"})
"""By which this host calls itself."""


def names_this_host(host: str) -> bool:
    """Whether the name that was asked for is one of this host's; the port may be another one.

    Args:
        host: the header's text; behind `ssh -L` it has the port of the other end.
    """
    try:
        return urlsplit(f"//{host}").hostname in _NAMES
    except ValueError:
        return False


def is_of_the_page(origin: str, host: str) -> bool:
    """Whether the page that asks came from where it asks.

    Args:
        origin: the header's text.
        host: the header's text.
    """
    return origin == f"http://{host}"
