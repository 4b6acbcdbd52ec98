"""A ROS domain in which nobody on this host speaks.

A domain is a range of UDP ports. Source: DDSI-RTPS 2.5, 9.6.2.3: 7400 + 250 * domain, of which
offsets 0 and 1 and those from 10 on are used.
"""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import psutil

from obk_cli.errors import CommandFailedError

__all__ = ["free_domain"]

FIRST_PORT: Final = 7400
PORTS: Final = 250
"""Of one domain."""
MARK: Final = 9
"""An offset that DDS does not use: bound by whoever has taken the domain here."""
DOMAINS: Final = range(100, 0, -1)
"""From above, as people take small ones; higher up the ports are handed out to others."""


@contextmanager
def free_domain() -> Iterator[int]:
    """While entered, a domain that is taken by nobody else who asks here.

    Raises:
        CommandFailedError: there is none.
    """
    bound = [place.laddr for place in psutil.net_connections(kind="udp") if place.laddr]
    used = {(address.port - FIRST_PORT) // PORTS for address in bound}
    for domain in DOMAINS:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mark:
            if domain in used or not _is_bound(mark, FIRST_PORT + PORTS * domain + MARK):
                continue
            yield domain
            return
    raise CommandFailedError("on this host every ROS domain from 1 to 100 is in use")


def _is_bound(mark: socket.socket, port: int) -> bool:
    try:
        mark.bind(("127.0.0.1", port))
    except OSError:
        return False
    return True
