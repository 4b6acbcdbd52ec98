"""The private folder of a run, and the sockets in it: who listens, and who may connect.

The launcher makes the folder and names it to its processes by `LOCAL_TRANSPORT_VARIABLE`. A socket
has the GID of its subscription as its name. GIDs are never used again, so the file that a killed
process leaves can only refuse connections.
"""

import functools
import os
import socket
import stat
import struct
from contextlib import suppress
from typing import Final

from rclpy.logging import get_logger

from obelisk_spec.runtime_protocol import LOCAL_TRANSPORT_OFF, LOCAL_TRANSPORT_VARIABLE

__all__ = ["SocketFolder", "peer_process", "socket_folder"]

_CREDENTIALS: Final = struct.Struct("3i")
"""`struct ucred`: process, user, group. Source: unix(7), SO_PEERCRED."""
_BACKLOG: Final = 128
_LOGGER: Final = "local_transport"


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

    def listen(self, gid: bytes) -> socket.socket:
        """A socket to which publishers connect, for the subscription with this GID.

        Raises:
            OSError: the folder is gone, or its file system has no sockets.
        """
        listener = _new_socket()
        try:
            listener.bind(self._address(gid))
            listener.listen(_BACKLOG)
        except OSError:
            listener.close()
            raise
        return listener

    def connect(self, gid: bytes) -> socket.socket | None:
        """A connection to the subscription with this GID; None if it has no socket here."""
        connection = _new_socket()
        try:
            connection.connect(self._address(gid))
        except OSError:
            connection.close()
            return None
        if peer_process(connection) is None:
            connection.close()
            return None
        return connection

    def remove(self, gid: bytes) -> None:
        """Remove the socket of a subscription; its connections stay."""
        with suppress(OSError):
            os.unlink(gid.hex(), dir_fd=self._fd)

    def _address(self, gid: bytes) -> str:
        # The path of the folder may be longer than an address can be.
        return f"/proc/self/fd/{self._fd}/{gid.hex()}"


def _new_socket() -> socket.socket:
    kind = socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
    return socket.socket(socket.AF_UNIX, kind)


def peer_process(connection: socket.socket) -> int | None:
    """The id of the process at the other end; None if it belongs to another user."""
    size = _CREDENTIALS.size
    credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size)
    process, user, _ = _CREDENTIALS.unpack(credentials)
    return int(process) if user == os.getuid() else None


def socket_folder() -> SocketFolder | None:
    """The folder of this process's run; None: no local transport."""
    path = os.environ.get(LOCAL_TRANSPORT_VARIABLE, LOCAL_TRANSPORT_OFF)
    return None if path == LOCAL_TRANSPORT_OFF else _opened(path)


@functools.cache
def _opened(path: str) -> SocketFolder | None:
    try:
        return SocketFolder(path)
    except FileNotFoundError:  # a late restart: the run has ended
        return None
    except OSError as error:
        get_logger(_LOGGER).warning(f"no local transport, messages go through DDS: {error}")
        return None
