"""Datagrams sent and awaited in this process: to an address, and to a group, each way.

Source: DDSI-RTPS 2.5, 9.6.1.4.2: participants are discovered at the group 239.255.0.1.
"""

import socket
import struct
from typing import Final

from obk_cli.doctor.network import MulticastFacts

__all__ = ["probe_multicast"]

GROUP: Final = "239.255.0.1"
LOOPBACK: Final = "127.0.0.1"
ANY: Final = "0.0.0.0"  # noqa: S104 - the kernel's choice; nothing is bound to it
ANSWER_S: Final = 1.0
WORDS: Final = b"obk doctor"


def probe_multicast() -> MulticastFacts:
    """Try the three ways."""
    return MulticastFacts(
        group=GROUP,
        loopback_fault=_multicast_fault(LOOPBACK),
        network_fault=_multicast_fault(ANY),
        unicast_fault=_unicast_fault(),
    )


def _multicast_fault(interface: str) -> str:
    """Why a datagram to the group does not come back over an interface; empty: it does."""
    address = socket.inet_aton(interface)
    try:
        with _udp() as receiver, _udp() as sender:
            receiver.bind((GROUP, 0))
            receiver.settimeout(ANSWER_S)
            membership = struct.pack("4s4s", socket.inet_aton(GROUP), address)
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
            if interface != ANY:
                sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, address)
            # What is tried is this host: nobody else need hear it.
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
            return _sent_and_awaited(sender, receiver, GROUP)
    except OSError as fault:
        return _told(fault)


def _unicast_fault() -> str:
    try:
        with _udp() as receiver, _udp() as sender:
            receiver.bind((LOOPBACK, 0))
            receiver.settimeout(ANSWER_S)
            return _sent_and_awaited(sender, receiver, LOOPBACK)
    except OSError as fault:
        return _told(fault)


def _sent_and_awaited(sender: socket.socket, receiver: socket.socket, to: str) -> str:
    sender.sendto(WORDS, (to, receiver.getsockname()[1]))
    return "" if receiver.recv(64) == WORDS else "other bytes arrived"


def _udp() -> socket.socket:
    return socket.socket(socket.AF_INET, socket.SOCK_DGRAM)


def _told(fault: OSError) -> str:
    if isinstance(fault, TimeoutError):
        return f"nothing came within {ANSWER_S:.0f} s"
    return fault.strerror or str(fault)
