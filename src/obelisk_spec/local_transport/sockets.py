"""The private folder of a run and the sockets in it: who listens, who may connect, what is sent.

The launcher makes the folder and names it to its processes by `LOCAL_TRANSPORT_VARIABLE`. The name
of a socket is the GID of its subscription, and the history depth of that. GIDs are never used
again, so the file that a killed process leaves can only refuse connections.

Over a socket go packets of one message each. A connection begins with a greeting: the
GID of the publisher, and how many packets it has sent to any subscription before. Every other
packet is a message and its `Stamp`. A packet that is only a number names a message of DDS that is
to be dropped, because a packet has delivered it.

A subscription sends one packet back, the `CONFIRMATION`, once it has a message of the publisher
from DDS. Until then the publisher sends everything through DDS.

With the greeting comes a page of memory with one number, which the publisher sets before it sends
through DDS: so many packets precede. While the socket is full, they still wait in the publisher.
"""

import fcntl
import mmap
import os
import socket
import stat
import struct
import weakref
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

__all__ = [
    "CONFIRMATION",
    "LARGEST_MESSAGE",
    "LARGEST_PACKET",
    "NUMBER_BYTES",
    "STAMP_BYTES",
    "Greeting",
    "SocketFolder",
    "Stamp",
    "greeting_of",
    "new_page",
    "number_of",
    "packed_number",
    "packed_stamp",
    "peer_process",
    "received_page",
    "stamp_of",
]


_CREDENTIALS: Final = struct.Struct("3i")
"""`struct ucred`: process, user, group. Source: unix(7), SO_PEERCRED."""
_BACKLOG: Final = 128
_MAGIC: Final = b"OBK1"
CONFIRMATION: Final = b"\1"
_GREETING: Final = struct.Struct("<4s16sQ")
_STAMP: Final = struct.Struct("<qQQ")
_NUMBER: Final = struct.Struct("<Q")
NUMBER_BYTES: Final = _NUMBER.size
STAMP_BYTES: Final = _STAMP.size
LARGEST_MESSAGE: Final = 64 * 1024
"""Larger messages go through DDS [bytes]."""
LARGEST_PACKET: Final = LARGEST_MESSAGE + STAMP_BYTES


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


def new_page() -> tuple[int, "memoryview[int]"]:
    """A page for a connection: its descriptor, which the caller closes, and its number."""
    page = os.memfd_create("obk_packets", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    os.ftruncate(page, mmap.PAGESIZE)
    fcntl.fcntl(page, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK)
    return page, _mapped(page)


def received_page(page: int) -> "memoryview[int] | None":
    """The number in a page from the other end; None if the memory may go away."""
    try:
        seals = fcntl.fcntl(page, fcntl.F_GET_SEALS)
    except OSError:  # something else
        return None
    is_safe = seals & fcntl.F_SEAL_SHRINK and os.fstat(page).st_size >= mmap.PAGESIZE
    return _mapped(page) if is_safe else None


def _mapped(page: int) -> "memoryview[int]":
    return memoryview(mmap.mmap(page, mmap.PAGESIZE)).cast("Q")


@dataclass(frozen=True, slots=True, kw_only=True)
class Greeting:
    """The first packet of a connection."""

    publisher: bytes
    """Its GID."""
    packets: int
    """How many messages it has sent by packets so far."""

    def __bytes__(self) -> bytes:
        return _GREETING.pack(_MAGIC, self.publisher, self.packets)


@dataclass(frozen=True, slots=True, kw_only=True)
class Stamp:
    """The end of a packet."""

    published_ns: int
    """When the message was published [ns since 1970]."""
    packets: int
    """How many messages the publisher has sent by packets, with this one."""
    number: int
    """How many messages it has sent through DDS before."""


def greeting_of(packet: bytes) -> Greeting | None:
    """The greeting that a first packet is; None if it is none."""
    if len(packet) != _GREETING.size or not packet.startswith(_MAGIC):
        return None
    _, publisher, packets = _GREETING.unpack(packet)
    return Greeting(publisher=publisher, packets=packets)


packed_stamp = _STAMP.pack
"""The end of a packet, by the fields of `Stamp`."""

packed_number = _NUMBER.pack
"""A number, as packets end with it."""


def stamp_of(packet: bytes) -> Stamp:
    """The stamp of a message; the packet is not shorter."""
    published_ns, packets, number = _STAMP.unpack_from(packet, len(packet) - STAMP_BYTES)
    return Stamp(published_ns=published_ns, packets=packets, number=number)


def number_of(packet: bytes) -> int:
    """The number at the end of a packet, which is not shorter than a number."""
    return int(_NUMBER.unpack_from(packet, len(packet) - NUMBER_BYTES)[0])
