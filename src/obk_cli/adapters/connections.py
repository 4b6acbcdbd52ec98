"""Whose a TCP connection within this host is, as the kernel tells.

Source: proc_pid_net(5), `/proc/net/tcp`.
"""

import socket
import sys
from pathlib import Path
from typing import Final

__all__ = ["user_of_connection"]

TABLES: Final = (Path("/proc/net/tcp"), Path("/proc/net/tcp6"))
"""The second has those of programs that speak IPv6 with an IPv4 address."""
_LOCAL: Final = 1
_REMOTE: Final = 2
_USER: Final = 7
_INODE: Final = 9
"""Places in a row; no inode: the process has let go of it, and whose it was is not told."""


def user_of_connection(client: tuple[str, int], port: int) -> int | None:
    """The user whose process has made a connection; None: it is not told, or is not there any more.

    Args:
        client: address and port of that process's end.
        port: of this process's end.
    """
    address = int.from_bytes(socket.inet_aton(client[0]), sys.byteorder)
    local, remote = f"{address:08X}:{client[1]:04X}", f":{port:04X}"
    for table in TABLES:
        for line in table.read_text().splitlines() if table.exists() else ():
            row = line.split()
            if row[_LOCAL].endswith(local) and row[_REMOTE].endswith(remote):
                return int(row[_USER]) if int(row[_INODE]) else None
    return None
