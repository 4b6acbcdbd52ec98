"""The private folder of a run and its sockets: names, access, and packets.

The launcher creates the folder and passes its path to its processes in `LOCAL_TRANSPORT_VARIABLE`.
The name of a socket consists of the GID and the history depth of its subscription. GIDs are never
reused, so if a killed process leaves a file, it can only refuse connections.

Each packet on a socket holds one message. A connection starts with a greeting: the GID of the
publisher, and the number of packets that it has sent to any subscription so far. Every other packet
is a message followed by its `Stamp`. A packet with only a number identifies a message in DDS that
must be dropped, because a packet has already delivered it.

A subscription sends a single packet back, the `CONFIRMATION`, once it has received a message of the
publisher from DDS. Until then, the publisher sends everything through DDS.

The greeting comes with a page of shared memory. The publisher writes two numbers into it before it
sends a message through DDS: how many packets precede the message, and the number of the last
message in DDS that a packet has already delivered. If the socket is full, some packets are still
waiting in the publisher. Then it also writes the number of the last waiting packet, because the
socket holds messages that the subscription's history would have dropped.
"""

import fcntl
import mmap
import os
import re
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
_SOCKET_NAME: Final = re.compile(r"(?P<gid>[0-9a-f]{32})-(?P<depth>[0-9]+)")
"""Other files, such as those of a network file system, may appear in the folder."""
_MAGIC: Final = b"OBK1"
CONFIRMATION: Final = b"\1"
_GREETING: Final = struct.Struct("<4s16sQ")
_STAMP: Final = struct.Struct("<qQQ")
_NUMBER: Final = struct.Struct("<Q")
NUMBER_BYTES: Final = _NUMBER.size
STAMP_BYTES: Final = _STAMP.size
LARGEST_MESSAGE: Final = 64 * 1024
"""Larger messages are sent through DDS [bytes]."""
LARGEST_PACKET: Final = LARGEST_MESSAGE + STAMP_BYTES


class SocketFolder:
    """A folder that only this user can access."""

    def __init__(self, path: str) -> None:
        """Open and check the folder.

        Raises:
            OSError: the folder does not exist or is not private.
        """
        self._fd = os.open(path, os.O_PATH | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
        status = os.fstat(self._fd)
        if status.st_uid != os.getuid() or stat.S_IMODE(status.st_mode) & 0o077:
            os.close(self._fd)
            raise PermissionError(f"{path} is accessible to other users, expected mode 0700")
        weakref.finalize(self, os.close, self._fd)

    def listen(self, gid: bytes, depth: int) -> socket.socket:
        """Open a socket for the publishers of a subscription with this GID and depth.

        Raises:
            OSError: the folder was removed, or its file system does not support sockets.
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
        """Return the subscriptions with a socket file here, even a stale one: GID -> depth."""
        found = {}
        with suppress(OSError):  # the run has ended
            for name in os.listdir(f"/proc/self/fd/{self._fd}"):  # noqa: PTH208 - a descriptor
                if socket_name := _SOCKET_NAME.fullmatch(name):
                    found[bytes.fromhex(socket_name["gid"])] = int(socket_name["depth"])
        return found

    def connect(self, gid: bytes, depth: int) -> socket.socket | None:
        """Connect to a subscription; None if its process has ended.

        Raises:
            OSError: this process has no descriptors left.
        """
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
        """Remove the socket file of a subscription; its connections stay open."""
        with suppress(OSError):
            os.unlink(_name(gid, depth), dir_fd=self._fd)

    def _address(self, name: str) -> str:
        # The folder's path may exceed the maximum length of a socket address.
        return f"/proc/self/fd/{self._fd}/{name}"


def _name(gid: bytes, depth: int) -> str:
    return f"{gid.hex()}-{depth}"


def _new_socket() -> socket.socket:
    kind = socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
    return socket.socket(socket.AF_UNIX, kind)


def peer_process(connection: socket.socket) -> int | None:
    """Return the id of the process at the other end; None if it belongs to another user."""
    size = _CREDENTIALS.size
    credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size)
    process, user, _ = _CREDENTIALS.unpack(credentials)
    return int(process) if user == os.getuid() else None


def new_page() -> tuple[int, "memoryview[int]"]:
    """Create the page of a connection: its descriptor, which the caller closes, and its numbers.

    Raises:
        OSError: this process has no descriptors left.
    """
    page = os.memfd_create("obk_packets", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    os.ftruncate(page, mmap.PAGESIZE)
    fcntl.fcntl(page, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK)
    try:
        return page, _mapped(page)
    except OSError:  # the map has a descriptor of its own
        os.close(page)
        raise


def received_page(page: int) -> "memoryview[int] | None":
    """Map the page from the other end; None if its memory could be removed.

    Raises:
        OSError: this process has no descriptors left.
    """
    try:
        seals = fcntl.fcntl(page, fcntl.F_GET_SEALS)
    except OSError:  # not a memory file
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
    """Number of messages that it has sent as packets so far."""

    def __bytes__(self) -> bytes:
        return _GREETING.pack(_MAGIC, self.publisher, self.packets)


@dataclass(frozen=True, slots=True, kw_only=True)
class Stamp:
    """The end of a packet."""

    published_ns: int
    """Time of publication [ns since 1970]."""
    packets: int
    """Number of messages that the publisher has sent as packets, including this one."""
    number: int
    """Number of messages that it sent through DDS before this one."""


def greeting_of(packet: bytes) -> Greeting | None:
    """Parse the first packet of a connection; None if it is not a greeting."""
    if len(packet) != _GREETING.size or not packet.startswith(_MAGIC):
        return None
    _, publisher, packets = _GREETING.unpack(packet)
    return Greeting(publisher=publisher, packets=packets)


packed_stamp = _STAMP.pack
"""Pack the end of a packet; takes the fields of `Stamp`."""

packed_number = _NUMBER.pack
"""Pack a number, in the form at the end of a packet."""


def stamp_of(packet: bytes) -> Stamp:
    """Parse the stamp of a message; the packet must not be shorter than a stamp."""
    published_ns, packets, number = _STAMP.unpack_from(packet, len(packet) - STAMP_BYTES)
    return Stamp(published_ns=published_ns, packets=packets, number=number)


def number_of(packet: bytes) -> int:
    """Parse the number at the end of a packet, which must not be shorter than a number."""
    return int(_NUMBER.unpack_from(packet, len(packet) - NUMBER_BYTES)[0])
