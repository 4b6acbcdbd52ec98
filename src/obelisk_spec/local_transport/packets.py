"""What goes over a socket of the local transport: packets of one message each.

A connection begins with a greeting: the GID of the publisher, and how many packets it has sent to
anybody before. Every other packet is a message and its `Stamp`. A packet that is only a number
names a message of DDS that is to be dropped, because a packet has delivered it.
"""

import struct
from dataclasses import dataclass
from typing import Final

__all__ = [
    "LARGEST_MESSAGE",
    "LARGEST_PACKET",
    "NUMBER_BYTES",
    "STAMP_BYTES",
    "Greeting",
    "Stamp",
    "greeting_of",
    "number_of",
    "packed_number",
    "packed_stamp",
    "stamp_of",
]

_MAGIC: Final = b"OBK1"
_GREETING: Final = struct.Struct("<4s16sQ")
_STAMP: Final = struct.Struct("<qQQ")
_NUMBER: Final = struct.Struct("<Q")
NUMBER_BYTES: Final = _NUMBER.size
STAMP_BYTES: Final = _STAMP.size
LARGEST_MESSAGE: Final = 64 * 1024
"""Larger messages go through DDS [bytes]."""
LARGEST_PACKET: Final = LARGEST_MESSAGE + STAMP_BYTES


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
