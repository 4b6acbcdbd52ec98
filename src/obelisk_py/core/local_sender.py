"""Send a publisher's messages to subscriptions on this host through Unix sockets.

Each subscription that runs in the library's executor listens on a Unix socket in the run's private
folder. The socket is named after the subscription's GID; see `executor.local_receiver`. Packets and
sockets, which the tools also use, are defined in `obelisk_spec.local_transport`.

A publisher bypasses DDS only while it can reach every subscription that DDS has matched with it,
either by a buffer in its own process or by a connection. It checks this by GID whenever a
connection or DDS's count of matches changes. Between these checks, comparing the count is enough,
because a subscription closes its socket before it leaves DDS.

If a socket is full, a thread sends the waiting packets once the subscription reads again. The
thread is started when this first happens, so publishers need no executor and usually no thread.
"""

import functools
import os
import select
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from socket import send_fds, socket
from typing import Any, Final, Protocol

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.logging import get_logger
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from obelisk_spec.local_transport.dds_reader import GID_BYTES, participant_of, publisher_gid
from obelisk_spec.local_transport.sockets import (
    CONFIRMATION,
    LARGEST_MESSAGE,
    NUMBER_BYTES,
    Greeting,
    SocketFolder,
    new_page,
    packed_number,
    packed_stamp,
    peer_process,
    stamp_of,
)
from obelisk_spec.runtime_protocol import LOCAL_TRANSPORT_OFF, LOCAL_TRANSPORT_VARIABLE

__all__ = [
    "Flusher",
    "LocalSender",
    "Peer",
    "SubscriptionEndpoint",
    "flusher_of",
    "socket_folder",
    "subscriptions_of",
]


_LOGGER: Final = "local_transport"
_CHECK_PERIOD_S: Final = 0.25
"""How often a publisher looks for the socket of a subscription that has none yet [s].

While the list contains a subscription of a killed process, the publisher also updates the list at
this interval. When DDS drops that subscription, the count may stay the same because another one was
matched in the meantime.
"""

_READY_PERIOD_S: Final = 0.01
"""How often a publisher checks for the confirmation of a new connection [s]."""


def socket_folder() -> SocketFolder | None:
    """Return the folder of this process's run; None if local transport is off."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class SubscriptionEndpoint:
    """A subscription in the ROS graph."""

    gid: bytes
    node: tuple[str, str]
    """Name and namespace."""
    type_name: str
    is_reliable: bool
    is_volatile: bool


def subscriptions_of(node_handle: Any, topic: str) -> list[SubscriptionEndpoint]:
    """Return a topic's subscriptions that the node's context has discovered, including its own.

    A subscription is listed before DDS counts it as matched with a publisher.

    Args:
        node_handle: an rclpy handle.
        topic: full name of the topic.
    """
    with node_handle:
        found = rclpy_implementation.rclpy_get_subscriptions_info_by_topic(
            node_handle, topic, False
        )
    return [
        SubscriptionEndpoint(
            gid=bytes(info["endpoint_gid"][:GID_BYTES]),
            node=(info["node_name"], info["node_namespace"]),
            type_name=info["topic_type"],
            is_reliable=info["qos_profile"]["reliability"] == ReliabilityPolicy.RELIABLE,
            is_volatile=info["qos_profile"]["durability"] == DurabilityPolicy.VOLATILE,
        )
        for info in found
    ]


class _Waiting(Protocol):
    def fileno(self) -> int: ...

    def flush(self) -> bool:
        """Send waiting packets; true if some are left."""


class Flusher:
    """A thread that flushes connections whose sockets were full."""

    def __init__(self) -> None:
        """Start the thread."""
        self._epoll = select.epoll()
        # A closed connection is never ready, so nothing would remove it.
        self._waiting = weakref.WeakValueDictionary[int, _Waiting]()
        threading.Thread(target=self._run, name="local transport", daemon=True).start()

    def watch(self, connection: _Waiting) -> None:
        """Flush a connection when its socket accepts packets again; thread-safe."""
        fd = connection.fileno()
        self._waiting[fd] = connection
        flags = select.EPOLLOUT | select.EPOLLONESHOT
        try:
            self._epoll.register(fd, flags)
        except FileExistsError:
            self._epoll.modify(fd, flags)

    def _run(self) -> None:
        while True:
            for fd, _ in self._epoll.poll():
                connection = self._waiting.pop(fd, None)
                if connection is not None and connection.flush():
                    with suppress(OSError, ValueError):  # closed in the meantime
                        self.watch(connection)


@functools.cache
def flusher_of(_process: int) -> Flusher:
    """Return the flusher of this process; a forked process gets its own."""
    return Flusher()


class Peer:
    """The connection to one subscription.

    Packets that do not fit into the socket wait here, up to the depth of the subscription's
    history.
    """

    def __init__(self, connection: socket, gid: bytes, depth: int, greeting: bytes) -> None:
        """Take ownership of a connection and send the greeting.

        Args:
            connection: open and non-blocking.
            gid: the subscription's GID.
            depth: depth of the subscription's history.
            greeting: the publisher's greeting.

        Raises:
            OSError: this process has no descriptors left; the connection was closed.
        """
        try:
            page, self._page = new_page()
        except OSError:
            connection.close()
            raise
        with suppress(OSError):  # already lost
            send_fds(connection, [greeting], [page])
        os.close(page)
        self.gid = gid
        self.is_lost = False
        self._socket = connection
        self._send = connection.send
        self._is_confirmed = False
        self._waiting: deque[bytes] = deque(maxlen=depth)
        self._lock = threading.Lock()

    def fileno(self) -> int:
        """The descriptor; -1 once closed."""
        return self._socket.fileno()

    @property
    def process(self) -> int:
        """Id of the other process; 0 if it is hidden in another namespace."""
        return peer_process(self._socket) or 0

    @property
    def is_confirmed(self) -> bool:
        """Whether the subscription has confirmed that it receives the publisher's DDS messages."""
        if not self._is_confirmed:
            with suppress(OSError):  # no confirmation yet, or the connection is lost
                self._is_confirmed = self._socket.recv(len(CONFIRMATION)) == CONFIRMATION
        return self._is_confirmed

    def send(self, packet: bytes) -> bool:
        """Send a packet, or queue it if the socket is full; false if the connection is lost."""
        if not self._waiting:
            try:
                self._send(packet)
            except BlockingIOError:
                pass
            except OSError:
                self.is_lost = True
                return False
            else:
                return True
        with self._lock:
            if self.is_lost:
                return False
            was_empty = not self._waiting
            self._waiting.append(packet)
            if len(packet) > NUMBER_BYTES:
                self._page[2] = stamp_of(packet).packets
            if was_empty:
                flusher_of(os.getpid()).watch(self)
        return True

    def flush(self) -> bool:
        """Send waiting packets until the socket is full; true if some are left."""
        with self._lock:
            try:
                while self._waiting:
                    self._send(self._waiting[0])
                    self._waiting.popleft()
            except BlockingIOError:
                return True
            except OSError:
                self.is_lost = True
            return False

    def skip(self, number: int) -> None:
        """Make the subscription drop the DDS copy of the message that was just sent as a packet.

        If the packet is still waiting, it is withdrawn instead.

        Args:
            number: number of the message among the publisher's messages in DDS.
        """
        with self._lock:
            if self._waiting:
                self._waiting.pop()
                return
        self._page[1] = number
        self.send(packed_number(number))

    def precede(self, packets: int) -> None:
        """If packets are waiting, make later DDS messages wait for packets up to this number."""
        if self._waiting:
            self._page[0] = packets

    def close(self, end_s: float = 0.0) -> None:
        """Close the connection; the subscription still receives everything already sent.

        Args:
            end_s: until when to wait for the socket to accept the waiting packets, in the time of
                `time.monotonic` [s].
        """
        while self.flush() and (left_s := end_s - time.monotonic()) > 0:
            _wait_for(self._socket.fileno(), select.POLLOUT, left_s)
        with self._lock:
            self.is_lost = True
            self._socket.close()


class LocalSender:
    """The connections of one publisher; only the thread that holds `lock` may use them."""

    def __init__(
        self,
        folder: SocketFolder,
        *,
        node_handle: Any,
        handle: Any,
        topic: str,
        type_name: str,
        qos: QoSProfile,
    ) -> None:
        """Create a sender without connections.

        Args:
            folder: the run's socket folder.
            node_handle: handle of the publisher's node.
            handle: the publisher's handle.
            topic: full name of the topic.
            type_name: message type, `package/msg/Name`.
            qos: the publisher's QoS profile; must be plain.
        """
        self.lock = threading.RLock()
        """Held for a whole message, which may go to some as packets and to the rest through DDS."""
        self.peers: tuple[Peer, ...] = ()
        """The open connections; complete only while they cover everything that DDS has matched."""
        self._folder = folder
        self._node_handle = node_handle
        self._topic = topic
        self._type_name = type_name
        self._is_reliable = qos.reliability == ReliabilityPolicy.RELIABLE
        self._gid = publisher_gid(handle)
        self._sent_through_dds = 0
        self._sent_by_packets = 0
        self._is_covered = False
        self._count = self._buffers = -1
        self._next_check_s = 0.0
        self._covers_killed = False
        """Whether DDS still counts a subscription of a killed process as matched."""
        self._lost: dict[bytes, int] = {}
        """Process ids of lost connections, by GID."""
        self._skip: tuple[Peer, ...] = ()
        """Peers that already have the message that DDS delivers next."""

    def covers(self, count: int, buffers: int) -> bool:
        """Whether the peers and this process's buffers are everything that DDS has matched.

        Args:
            count: number of subscriptions that DDS has matched with the publisher.
            buffers: number of these that are buffers in this process.
        """
        if not count:
            self._count = -1  # a subscription that is matched next is a new one
            return False
        if count == self._count and buffers == self._buffers:
            if self._is_covered and not self._covers_killed:
                return True
            if time.monotonic() < self._next_check_s:
                return self._is_covered
        return self._check(count, buffers)

    def send(self, data: bytes) -> bool:
        """Send a serialized message to all peers; false if DDS must deliver it to all."""
        if len(data) > LARGEST_MESSAGE:
            return False
        self._sent_by_packets += 1
        packet = data + packed_stamp(time.time_ns(), self._sent_by_packets, self._sent_through_dds)
        for place, peer in enumerate(self.peers):
            if not peer.send(packet):
                self._is_covered = False
                self._next_check_s = 0.0
                self._sent_by_packets -= 1  # it counts as sent through DDS
                self._skip = self.peers[:place]
                return False
        return True

    def send_through_dds(self, send: Callable[[], None]) -> None:
        """Let DDS deliver a message after everything that the peers have received."""
        number = self._sent_through_dds + 1
        # A connection was lost after these peers got the message; they must not receive it twice.
        for peer in self._skip:
            peer.skip(number)
        self._skip = ()
        for peer in self.peers:
            peer.precede(self._sent_by_packets)
        send()
        self._sent_through_dds = number

    def close(self, end_s: float) -> None:
        """Close all connections; see `Peer.close`."""
        for peer in self.peers:
            peer.close(end_s)
        self.peers = ()
        self._is_covered = False

    def _check(self, count: int, buffers: int) -> bool:
        endpoints = [
            endpoint
            for endpoint in subscriptions_of(self._node_handle, self._topic)
            if self._fits(endpoint)
        ]
        remote = {endpoint.gid for endpoint in endpoints if not self._is_own(endpoint.gid)}
        peers = self._connected(remote)
        self.peers = tuple(peers.values())
        # DDS must have matched every listed subscription. Otherwise an unmatched one could be
        # mistaken for another one that has no socket.
        is_exact = count == len(endpoints) and buffers == len(endpoints) - len(remote)
        self._count, self._buffers = count, buffers
        self._next_check_s = time.monotonic() + _CHECK_PERIOD_S
        self._is_covered = False
        if not is_exact:
            return False
        without_peer = remote - peers.keys()
        if not all(map(self._has_ended, without_peer)):
            return False
        # The publisher is matched first; until the subscription is too, it receives nothing.
        if not all(peer.is_confirmed for peer in self.peers):
            self._next_check_s = time.monotonic() + _READY_PERIOD_S
            return False
        self._covers_killed = bool(without_peer)
        self._is_covered = True
        return True

    def _fits(self, endpoint: SubscriptionEndpoint) -> bool:
        """Whether DDS matches a subscription, judged by the QoS profiles in the ROS graph."""
        return (
            endpoint.type_name == self._type_name
            and endpoint.is_volatile
            and (self._is_reliable or not endpoint.is_reliable)
        )

    def _is_own(self, gid: bytes) -> bool:
        return participant_of(gid) == participant_of(self._gid)

    def _connected(self, gids: set[bytes]) -> dict[bytes, Peer]:
        """Return the open connections to these subscriptions by GID, creating missing ones."""
        peers: dict[bytes, Peer] = {}
        for peer in self.peers:
            if peer.is_lost and peer.process:
                self._lost[peer.gid] = peer.process
            if peer.is_lost or peer.gid not in gids:
                peer.close()
            else:
                peers[peer.gid] = peer
        self._lost = {gid: process for gid, process in self._lost.items() if gid in gids}
        greeting = bytes(Greeting(publisher=self._gid, packets=self._sent_by_packets))
        new = gids - peers.keys()
        with suppress(OSError):  # no descriptors are left, so DDS delivers
            for gid, depth in (self._folder.depths() if new else {}).items():
                if gid in new and (connection := self._folder.connect(gid, depth)) is not None:
                    peers[gid] = Peer(connection, gid, depth, greeting)
        return peers

    def _has_ended(self, gid: bytes) -> bool:
        """Whether the process of a lost connection has ended; DDS detects this much later."""
        return gid in self._lost and not _is_alive(self._lost[gid])


def _is_alive(process: int) -> bool:
    try:
        descriptor = os.pidfd_open(process)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    try:
        return not _wait_for(descriptor, select.POLLIN, 0.0)  # a zombie is readable
    finally:
        os.close(descriptor)


def _wait_for(descriptor: int, event: int, timeout_s: float) -> bool:
    poll = select.poll()  # `select` does not support descriptors above 1023
    poll.register(descriptor, event)
    return bool(poll.poll(timeout_s * 1000))
