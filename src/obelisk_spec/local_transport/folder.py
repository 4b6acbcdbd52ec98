"""The private folder of a run, and the sockets in it: who listens, and who may connect.

The launcher makes the folder and names it to its processes by `LOCAL_TRANSPORT_VARIABLE`. The name
of a socket is the GID of its subscription, and the history depth of that. GIDs are never used
again, so the file that a killed process leaves can only refuse connections.
"""

import os
import socket
import stat
import struct
import weakref
from contextlib import suppress
from typing import Final

__all__ = ["SocketFolder", "peer_process"]

_CREDENTIALS: Final = struct.Struct("3i")
"""`struct ucred`: process, user, group. Source: unix(7), SO_PEERCRED."""
_BACKLOG: Final = 128


class SocketFolder:
    """A folder that only this user can enter."""

    def __init__(self, path: str) -> None:
        """Open the folder and check it.

        Raises:
            OSError: there is none, or it is not private.
        """
        self._fd = os.open(path, os.O_PATH | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
        status = os.fstat(self._fd)
        if status.st_uid != os.getuid() or stat.S_IMODE(status.st_mode) & 0o077:
            os.close(self._fd)
            raise PermissionError(f"{path} is open to others, expected a folder of mode 0700")
        weakref.finalize(self, os.close, self._fd)

    def listen(self, gid: bytes, depth: int) -> socket.socket:
        """A socket to which publishers connect, for the subscription with this GID and depth.

        Raises:
            OSError: the folder is gone, or its file system has no sockets.
        """
        listener = _new_socket()
        try:
            listener.bind(self._address(_name(gid, depth)))
            listener.listen(_BACKLOG)
        except OSError:
            listener.close()
            raise
        return listener

    def depths(self) -> dict[bytes, int]:
        """The subscriptions that have a socket here, and those that have left one: GID -> depth."""
        found = {}
        with suppress(OSError):  # the run has ended
            for name in os.listdir(f"/proc/self/fd/{self._fd}"):  # noqa: PTH208 - a descriptor
                gid, _, depth = name.partition("-")
                found[bytes.fromhex(gid)] = int(depth)
        return found

    def connect(self, gid: bytes, depth: int) -> socket.socket | None:
        """A connection to a subscription; None if its process has ended."""
        connection = _new_socket()
        try:
            connection.connect(self._address(_name(gid, depth)))
        except OSError:
            connection.close()
            return None
        if peer_process(connection) is None:
            connection.close()
            return None
        return connection

    def remove(self, gid: bytes, depth: int) -> None:
        """Remove the socket of a subscription; its connections stay."""
        with suppress(OSError):
            os.unlink(_name(gid, depth), dir_fd=self._fd)

    def _address(self, name: str) -> str:
        # The path of the folder may be longer than an address can be.
        return f"/proc/self/fd/{self._fd}/{name}"


def _name(gid: bytes, depth: int) -> str:
    return f"{gid.hex()}-{depth}"


def _new_socket() -> socket.socket:
    kind = socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
    return socket.socket(socket.AF_UNIX, kind)


def peer_process(connection: socket.socket) -> int | None:
    """The id of the process at the other end; None if it belongs to another user."""
    size = _CREDENTIALS.size
    credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size)
    process, user, _ = _CREDENTIALS.unpack(credentials)
    return int(process) if user == os.getuid() else None
