"""Receive a subscription's packets, and merge them with messages from DDS.

The messages of one publisher are delivered in the order of publishing. A packet waits until the
subscription has taken from DDS everything that was sent before. A message from DDS waits for the
packets that precede it. An inbox reads only on request and has no thread.
"""

import os
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from fcntl import ioctl
from math import inf
from socket import SHUT_RDWR, recv_fds, socket
from termios import FIONREAD
from typing import Final

from obelisk_spec.local_transport.sockets import (
    CONFIRMATION,
    LARGEST_PACKET,
    NUMBER_BYTES,
    STAMP_BYTES,
    SocketFolder,
    greeting_of,
    number_of,
    peer_process,
    received_page,
    stamp_of,
)

__all__ = ["Connection", "PublisherInbox"]

_RELIABLE_WAIT_S: Final = 4.0
"""How long a packet waits for an earlier message from DDS [s].

A reliable subscription detects missing messages by the publisher's heartbeats, which are sent every
3 s. If a message has not arrived by then, the publisher dropped it from its full history.
"""
_BEST_EFFORT_WAIT_S: Final = 0.05
"""The same for a best-effort subscription, whose messages DDS may lose [s]."""
_SUSPENDED_S: Final = 1.0
"""Minimum delay of a release that shows that the process was suspended [s]."""
_NO_BYTES: Final = bytes(4)
"""The answer to `FIONREAD` if no packet is waiting."""
_REMEMBERED: Final = 64
"""Number of unconnected publishers whose last message from DDS is remembered."""


class Connection:
    """A connection from a publisher."""

    def __init__(self, peer: socket, depth: int) -> None:
        """Take ownership of a non-blocking connection; up to `depth` packets may wait for DDS."""
        self.socket: Final = peer
        self.publisher: bytes | None = None
        """The publisher's GID; None before its greeting."""
        self.taken = 0
        """Number of the publisher's last message from DDS that was delivered or given up."""
        self.last = b""
        """Packet of the last message that was delivered."""
        self.packets_before = 0
        """Number of messages that it sent as packets before it connected."""
        self.ending = b""
        """A packed number, at most `taken`; packets that end with it need not wait."""
        self.held: deque[bytes] = deque(maxlen=depth)
        """Packets that wait for messages from DDS."""
        self.skipped: set[int] = set()
        """Numbers of messages in DDS that were also received as packets."""
        self.samples: deque[tuple[int, Callable[[int | None], object]]] = deque(maxlen=depth)
        """Messages from DDS that wait for packets: number, and function that delivers it."""
        self.page: memoryview[int] | None = None
        """Number of packets that precede the publisher's next message through DDS, number of the
        last message in DDS that must be dropped, and number of the last packet that had to wait."""
        self.outdated = 0
        """Packets up to this number were dropped."""
        self.overtaken = 0
        """Packets up to this number are too late: newer messages from DDS were delivered."""
        self.release_s = inf
        """When to stop waiting for what is missing (monotonic [s]); infinite if nothing waits."""
        self.last_skipped = 0
        """The largest number of a message in DDS that was also received as a packet."""
        self.has_ended = False
        """Whether the publisher has closed the connection and all packets were read."""

    @property
    def packets(self) -> int:
        """Number of messages that the publisher sent as packets, up to the last delivered one."""
        return stamp_of(self.last).packets if self.last else self.packets_before

    @property
    def is_done(self) -> bool:
        """Whether it is closed and nothing is waiting; messages from DDS do not wait then."""
        return self.socket.fileno() < 0 and not self.held

    @property
    def is_missing_packets(self) -> bool:
        """Whether packets that precede a message from DDS are still waiting in the publisher."""
        if self.has_ended or self.page is None:
            return False
        packet = self.held[-1] if self.held else self.last
        received = stamp_of(packet).packets if packet else self.packets_before
        skipped = max(self.last_skipped, number_of(packet) if packet else 0)
        return self.page[0] > received or self.page[1] > skipped


class PublisherInbox:
    """The listening socket of a subscription and its connections."""

    def __init__(
        self,
        folder: SocketFolder,
        gid: bytes,
        *,
        depth: int,
        is_reliable: bool,
        put: Callable[[bytes], object],
        on_connect: Callable[[Connection], object],
        on_wait: Callable[[], object] = lambda: None,
    ) -> None:
        """Open the socket, so that publishers can connect.

        Args:
            folder: the run's socket folder.
            gid: the subscription's GID.
            depth: depth of the subscription's history; limits the waiting packets per publisher.
            is_reliable: whether the subscription wants every message, even if it is late.
            put: receives the packet of each message when it is due.
            on_connect: receives each new connection; `read` it when its socket is readable.
            on_wait: called when a message has to wait; call `release` at the latest at
                `next_release_s`.

        Raises:
            OSError: the socket cannot be created in the folder.
        """
        self.listener: Final = folder.listen(gid, depth)
        self.connections: list[Connection] = []
        self._folder, self._gid, self._depth = folder, gid, depth
        self._put, self._on_connect, self._on_wait = put, on_connect, on_wait
        self._is_reliable = is_reliable
        self._wait_s = _RELIABLE_WAIT_S if is_reliable else _BEST_EFFORT_WAIT_S
        self._buffer = memoryview(bytearray(LARGEST_PACKET))
        self._by_publisher: dict[bytes, Connection] = {}
        self._unconnected: dict[bytes, tuple[int, int | None]] = {}
        """`Connection.taken` and `packets` of publishers that are not connected; None instead of
        the packets if the publisher never was."""

    @property
    def next_release_s(self) -> float:
        """When the next messages have waited long enough (monotonic [s]); infinite if none wait."""
        return min((connection.release_s for connection in self.connections), default=inf)

    def accept(self) -> None:
        """Accept new connections."""
        while True:
            try:
                peer, _ = self.listener.accept()
            except OSError:  # there is none, or the socket was stopped
                return
            if peer_process(peer) is None:
                peer.close()
                continue
            peer.setblocking(False)
            connection = Connection(peer, self._depth)
            self.connections.append(connection)
            self._on_connect(connection)

    def read(self, connection: Connection) -> bool:
        """Read all packets; true if the publisher has closed the connection.

        A closed connection is noticed only when no packets are left. So watch the socket,
        level-triggered, until this returns true.
        """
        peer, buffer, put, ending = connection.socket, self._buffer, self._put, connection.ending
        descriptor = peer.fileno()
        has_ended = False
        try:
            if connection.publisher is None:
                self._greet(connection)
            outdated = connection.overtaken
            if connection.page is not None:
                outdated = max(outdated, connection.page[2] - self._depth)
            while size := peer.recv_into(buffer):
                packet = buffer[:size].tobytes()
                if outdated > connection.outdated and _is_outdated(connection, packet, outdated):
                    pass
                elif ending and packet.endswith(ending) and size >= STAMP_BYTES:
                    connection.last = packet
                    put(packet)
                else:
                    self._sort(connection, packet)
                    ending = connection.ending
                # Raising an error for an empty socket takes longer than receiving a packet.
                if ioctl(descriptor, FIONREAD, _NO_BYTES) == _NO_BYTES:
                    break
            else:
                has_ended = True
        except BlockingIOError:
            pass
        except OSError:
            has_ended = True
        connection.has_ended = has_ended
        if connection.samples:
            self._advance(connection)
        self._note_wait(connection)
        return has_ended

    def merge(self, publisher: bytes, number: int, put: Callable[[int | None], object]) -> None:
        """Merge a message from DDS with the packets of its publisher.

        Args:
            publisher: the publisher's GID.
            number: number of the message among the publisher's messages in DDS.
            put: called when the message is due, with the number of packets that precede it, or None
                if its publisher was never connected; not called if a packet has delivered the
                message.
        """
        if publisher not in self._by_publisher:
            self.accept()
            for new in [new for new in self.connections if new.publisher is None]:
                self.read(new)
        connection = self._by_publisher.get(publisher)
        if connection is None:
            taken, packets = self._unconnected.get(publisher, (0, None))
            if number > taken:
                self._remember(publisher, number, packets)
                put(packets)
            return
        if number <= connection.taken:  # given up: it would overtake newer messages
            connection.skipped.discard(number)
            return
        if connection.taken == 0:
            _confirm(connection)
        connection.samples.append((number, put))
        # Everything sent before the message has arrived by now, unless the socket was full.
        self.read(connection)
        self._remove_done()

    def release(self, now_s: float = inf) -> None:
        """Deliver what has waited long enough, and skip the missing messages.

        A reliable subscription waits for packets until the publisher sends them or ends.

        Args:
            now_s: the monotonic time [s]; infinite to release everything.
        """
        for connection in self.connections:
            if connection.release_s > now_s:
                continue
            waits_for_packets = self._is_reliable and connection.is_missing_packets
            # And DDS with this process; a busy callback is no reason to wait again.
            was_suspended = now_s > connection.release_s + max(self._wait_s, _SUSPENDED_S)
            if now_s < inf and (waits_for_packets or was_suspended):
                connection.release_s = now_s + self._wait_s
            else:
                self._release_all(connection)
        self._remove_done()

    def forget(self, connection: Connection) -> None:
        """Close a connection after its packets were read; packets that wait for DDS are kept."""
        connection.socket.close()
        self._remove_done()

    def _remove_done(self) -> None:
        """Remove the closed connections that have no waiting packets."""
        for connection in [each for each in self.connections if each.is_done]:
            self._remove(connection)

    def _remove(self, connection: Connection) -> None:
        self.connections.remove(connection)
        publisher = connection.publisher
        if publisher is not None and self._by_publisher.get(publisher) is connection:
            del self._by_publisher[publisher]
            self._remember(publisher, connection.taken, connection.packets)

    def stop(self) -> None:
        """Stop publishers from sending, and read everything already sent.

        What waits for DDS still waits: `merge` what DDS has by now, then `release` the rest.
        """
        self._folder.remove(self._gid, self._depth)
        # From now on, connecting and sending fail, and DDS delivers instead.
        with suppress(OSError):
            self.listener.shutdown(SHUT_RDWR)
        self.accept()
        for connection in self.connections:
            with suppress(OSError):
                connection.socket.shutdown(SHUT_RDWR)
            self.read(connection)

    def close(self) -> None:
        """Close all sockets."""
        for connection in self.connections:
            connection.socket.close()
        self.connections.clear()
        self._by_publisher.clear()
        self.listener.close()

    def _sort(self, connection: Connection, packet: bytes) -> None:
        """Handle a packet that may have to wait or is not a message."""
        if len(packet) == NUMBER_BYTES:
            connection.last_skipped = number_of(packet)
            connection.skipped.add(connection.last_skipped)
        elif len(packet) < STAMP_BYTES:  # sent by a foreign program
            connection.socket.shutdown(SHUT_RDWR)
        elif number_of(packet) <= connection.taken:
            connection.ending = packet[-NUMBER_BYTES:]
            self._pass(connection, packet)
        else:
            connection.held.append(packet)

    def _greet(self, connection: Connection) -> None:
        packet, pages, _, _ = recv_fds(connection.socket, LARGEST_PACKET, 1)
        for page in pages:
            try:
                connection.page = received_page(page)
            finally:
                os.close(page)
        greeting = greeting_of(packet)
        if greeting is None:
            connection.socket.shutdown(SHUT_RDWR)
            return
        publisher = greeting.publisher
        before = self._by_publisher.get(publisher)
        if before is not None:  # the same publisher has connected again
            self.read(before)
            connection.held, before.held = before.held, connection.held
            connection.samples, before.samples = before.samples, connection.samples
            connection.skipped, before.skipped = before.skipped, connection.skipped
            self._note_wait(before)
        connection.publisher = publisher
        connection.packets_before = greeting.packets
        taken, _ = self._unconnected.pop(publisher, (0, None))
        connection.taken = before.taken if before else taken
        self._by_publisher[publisher] = connection
        if connection.taken:
            _confirm(connection)

    def _advance(self, connection: Connection) -> None:
        """Deliver messages from DDS that need not wait, and the packets that waited for them."""
        while connection.samples and not connection.is_missing_packets:
            self._put_sample(connection)

    def _note_wait(self, connection: Connection) -> None:
        """Set when a connection's messages have waited long enough, if any wait."""
        if not connection.held and not connection.samples:
            connection.release_s = inf
        elif connection.release_s == inf:
            connection.release_s = time.monotonic() + self._wait_s
            self._on_wait()

    def _put_sample(self, connection: Connection) -> None:
        number, put = connection.samples.popleft()
        connection.release_s = inf  # those that remain wait for another message
        self._release(connection, number - 1)  # anything that has not arrived by now is lost
        if number in connection.skipped:
            connection.skipped.discard(number)
            # The publisher counts the message among those sent through DDS.
            connection.packets_before, connection.last = connection.packets - 1, b""
        else:
            put(connection.packets)
        self._release(connection, number)

    def _release_all(self, connection: Connection) -> None:
        """Deliver everything that is waiting."""
        if connection.samples and connection.page is not None and connection.is_missing_packets:
            connection.overtaken = connection.page[0]
        while connection.samples:
            self._put_sample(connection)
        self._release(connection, None)

    def _release(self, connection: Connection, taken: int | None) -> None:
        """Deliver packets that wait for messages from DDS up to `taken`; None for all packets."""
        held = connection.held
        while held and (taken is None or number_of(held[0]) <= taken):
            connection.taken = max(connection.taken, number_of(held[0]))
            connection.release_s = inf
            self._pass(connection, held.popleft())
        connection.taken = max(connection.taken, taken or 0)

    def _pass(self, connection: Connection, packet: bytes) -> None:
        connection.last = packet
        self._put(packet)

    def _remember(self, publisher: bytes, number: int, packets: int | None) -> None:
        self._unconnected.pop(publisher, None)
        self._unconnected[publisher] = number, packets
        if len(self._unconnected) > _REMEMBERED:
            del self._unconnected[next(iter(self._unconnected))]


def _is_outdated(connection: Connection, packet: bytes, outdated: int) -> bool:
    """Whether a message would no longer be in the subscription's history.

    Args:
        connection: notes the packet, or that no packet is outdated any more.
        packet: the packet of any kind.
        outdated: number of the last outdated packet.
    """
    if len(packet) < STAMP_BYTES:
        return False
    if stamp_of(packet).packets > outdated:
        connection.outdated = outdated
        return False
    connection.last = packet
    return True


def _confirm(connection: Connection) -> None:
    """Confirm to the publisher that DDS delivers its messages."""
    with suppress(OSError):  # the connection is lost
        connection.socket.send(CONFIRMATION)
