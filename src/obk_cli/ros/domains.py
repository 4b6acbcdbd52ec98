"""Find out which ROS domains are in use on this host, by the UDP ports of their participants.

Every DDS participant binds ports that follow from its domain. Source: DDSI-RTPS 2.5, 9.6.2.3,
"Default port numbers".
"""

import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from obk_cli.errors import CommandFailedError

__all__ = ["free_domain", "is_used"]

FIRST_PORT: Final = 7400
PORTS: Final = 250
"""Number of ports per domain."""
MARK: Final = 9
"""A port offset that DDS does not use; the process that reserves the domain binds this port."""
DOMAINS: Final = range(100, 0, -1)
"""Descending, because people tend to use low numbers; higher domains use ephemeral ports."""
TABLE: Final = Path("/proc/net/udp")
"""The UDP sockets of this host. Source: proc_pid_net(5)."""
TABLE_IPV6: Final = Path("/proc/net/udp6")


def is_used(domain: int) -> bool:
    """Whether a participant of a domain may be running on this host, of any user.

    A domain above 100 may also seem to be used because of an ephemeral port.
    """
    first = FIRST_PORT + PORTS * domain
    try:
        used = set(_bound_ports())
    except OSError:
        return True
    return any(first <= port < first + PORTS and port != first + MARK for port in used)


@contextmanager
def free_domain() -> Iterator[int]:
    """Inside the `with` block, reserve a ROS domain that no other caller on this host has.

    Raises:
        CommandFailedError: no domain is free.
    """
    used = {(port - FIRST_PORT) // PORTS for port in _bound_ports()}
    for domain in DOMAINS:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mark:
            if domain in used or not _is_bound(mark, FIRST_PORT + PORTS * domain + MARK):
                continue
            yield domain
            return
    raise CommandFailedError("every ROS domain from 1 to 100 is in use on this host")


def _bound_ports() -> Iterator[int]:
    """The local ports of all UDP sockets.

    Raises:
        OSError: the kernel does not list them.
    """
    text = TABLE.read_text(encoding="ascii")
    with suppress(FileNotFoundError):  # a kernel without IPv6
        text += TABLE_IPV6.read_text(encoding="ascii")
    for line in text.splitlines():
        number, address, *_ = line.split()
        if number != "sl":  # the header
            yield int(address.rpartition(":")[2], 16)


def _is_bound(mark: socket.socket, port: int) -> bool:
    try:
        mark.bind(("127.0.0.1", port))
    except OSError:
        return False
    return True
