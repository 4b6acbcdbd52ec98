"""What goes over a socket of the local transport: packets of one message each.

A connection begins with a greeting, the GID of the publisher. Every other packet ends with a
number: how many messages the publisher had sent through DDS before. The subscription takes so many
from DDS first. A packet that is only a number names a message of DDS that is to be dropped, because
it was delivered by a packet.
"""

import struct
from typing import Final

__all__ = [
    "GREETING_BYTES",
    "LARGEST_MESSAGE",
    "LARGEST_PACKET",
    "NUMBER_BYTES",
    "greeted_by",
    "greeting",
    "number_of",
    "packed_number",
]

_MAGIC: Final = b"OBK1"
_GID_BYTES: Final = 16
_NUMBER: Final = struct.Struct("<Q")
GREETING_BYTES: Final = len(_MAGIC) + _GID_BYTES
NUMBER_BYTES: Final = _NUMBER.size
LARGEST_MESSAGE: Final = 64 * 1024
"""Larger messages go through DDS [bytes]."""
LARGEST_PACKET: Final = LARGEST_MESSAGE + NUMBER_BYTES


def greeting(publisher: bytes) -> bytes:
    """The first packet of a publisher with this GID."""
    return _MAGIC + publisher


def greeted_by(packet: bytes) -> bytes | None:
    """The GID of the publisher that sent a first packet; None if it is none."""
    if len(packet) != GREETING_BYTES or not packet.startswith(_MAGIC):
        return None
    return packet[len(_MAGIC) :]


def packed_number(number: int) -> bytes:
    """A number, as packets end with it."""
    return _NUMBER.pack(number)


def number_of(packet: bytes) -> int:
    """The number at the end of a packet.

    Raises:
        struct.error: the packet is shorter.
    """
    return int(_NUMBER.unpack_from(packet, len(packet) - NUMBER_BYTES)[0])
