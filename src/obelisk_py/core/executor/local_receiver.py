"""The subscription's side: a socket to which publishers connect, and the order of what they send.

The messages of one publisher may come by its socket and through DDS. They are delivered in the
order of publishing: a packet waits until the subscription has taken from DDS what was sent before,
and the packets that are older than a message of DDS are delivered before it.
"""

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from socket import SHUT_RDWR, socket
from typing import Any, Final

from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy
from rclpy.subscription import Subscription

from obelisk_py.core.executor.rcl_listeners import arm_timer, open_timer
from obelisk_py.core.executor.worker import ReadyCallback, Worker
from obelisk_py.core.intra_process import MessageBuffer
from obelisk_py.core.transport.dds_endpoints import (
    DdsReader,
    Sample,
    participant_of,
    publisher_gid,
    subscriptions_of,
)
from obelisk_py.core.transport.frames import (
    LARGEST_PACKET,
    NUMBER_BYTES,
    greeted_by,
    number_of,
)
from obelisk_py.core.transport.socket_folder import SocketFolder, peer_process, socket_folder

__all__ = ["LocalReceiver", "open_receiver"]

_RELIABLE_WAIT_S: Final = 1.0
"""How long a packet waits for an earlier message of DDS, which a full history may drop [s]."""
_BEST_EFFORT_WAIT_S: Final = 0.05
"""The same for a subscription whose messages DDS may lose [s]."""
_NS_PER_S: Final = 1_000_000_000
_REMEMBERED: Final = 64
"""Publishers without a connection whose last message of DDS is known."""


class _Connection:
    """A publisher that has connected."""

    def __init__(self, peer: socket, depth: int) -> None:
        self.socket = peer
        self.publisher: bytes | None = None
        """Its GID; None before its greeting."""
        self.taken = 0
        """The number of its last message that was taken from DDS."""
        self.ending = b""
        """The end of a packet that need not wait: a number up to `taken`, packed."""
        self.held: deque[bytes] = deque(maxlen=depth)
        """Packets that wait for messages of DDS."""
        self.skipped: set[int] = set()
        """Messages of DDS that came by packets too."""


class LocalReceiver:
    """The socket of a subscription, and its connections.

    It is run by one worker. `take` may be called by several threads.
    """

    group: CallbackGroup | None = None
    waits_for_group = False

    def __init__(
        self, folder: SocketFolder, gid: bytes, buffer: MessageBuffer, reader: DdsReader
    ) -> None:
        """Open the socket; publishers may connect from now on.

        Args:
            folder: of the run.
            gid: of the subscription.
            buffer: of the subscription; packets are put there.
            reader: of the subscription.

        Raises:
            OSError: the folder takes no socket.
        """
        self._listener = folder.listen(gid)
        self._folder, self._gid = folder, gid
        self._buffer = buffer
        self._reader = reader
        reliable = buffer.qos.reliability == ReliabilityPolicy.RELIABLE
        self._longest_wait_s = _RELIABLE_WAIT_S if reliable else _BEST_EFFORT_WAIT_S
        self._timer_fd = open_timer(time.CLOCK_MONOTONIC)
        self._connections: list[_Connection] = []
        self._by_publisher: dict[bytes, _Connection] = {}
        self._taken: dict[bytes, int] = {}
        """As `_Connection.taken`, of publishers that are not connected."""
        self._is_open = True
        self._lock = threading.RLock()
        self.deliver: Callable[[], bool] = self._wake
        """Called when the buffer has got messages; true if a callback of the user ran."""

    def ready_callbacks(self, worker: Worker) -> Mapping[int, ReadyCallback]:
        """The socket and the timer; connections are added to the worker when they are made."""
        return {
            self._listener.fileno(): partial(self._accept, worker),
            self._timer_fd: self._release_all,
        }

    def take(self) -> tuple[Any, Any] | None:
        """The next message with its info, from a publisher of this host or from DDS."""
        buffer = self._buffer
        while True:
            taken = buffer.take()
            if taken is not None:
                return taken
            with self._lock:
                mark = buffer.dds_mark
                sample = self._reader.take()
                if sample is None:
                    buffer.mark_dds_empty(mark)
                    return None
                self._merge(sample)

    def stop(self) -> None:
        """Let no publisher send any more; what was sent is put into the buffer."""
        with self._lock:
            self._folder.remove(self._gid)
            # Whoever connects or sends from now on gets an error, and DDS delivers instead.
            with suppress(OSError):
                self._listener.shutdown(SHUT_RDWR)
            with suppress(OSError):
                while True:
                    self._add(self._listener.accept()[0])
            for connection in self._connections:
                with suppress(OSError):
                    connection.socket.shutdown(SHUT_RDWR)
                self._read_all(connection)
                self._release(connection, None)
            self._is_open = False

    def close(self) -> None:
        """Close all descriptors, after no worker watches them any more."""
        with self._lock:
            for connection in self._connections:
                connection.socket.close()
            self._connections.clear()
            self._by_publisher.clear()
            self._listener.close()
            os.close(self._timer_fd)

    def _wake(self) -> bool:
        self._buffer.wake()
        return False

    def _accept(self, worker: Worker) -> bool:
        with self._lock, suppress(BlockingIOError):
            while self._is_open:
                connection = self._add(self._listener.accept()[0])
                if connection is not None:
                    fd = connection.socket.fileno()
                    worker.watch(self, fd, partial(self._read, worker, connection))
        return False

    def _add(self, peer: socket) -> _Connection | None:
        if peer_process(peer) is None:
            peer.close()
            return None
        peer.setblocking(False)
        connection = _Connection(peer, self._buffer.qos.depth)
        self._connections.append(connection)
        return connection

    def _read(self, worker: Worker, connection: _Connection) -> bool:
        with self._lock:
            if self._read_all(connection) and self._is_open:
                worker.unwatch(connection.socket.fileno())
                self._forget(connection)
        return self.deliver()

    def _read_all(self, connection: _Connection) -> bool:
        """Put all packets into the buffer; true if the publisher has closed the connection."""
        receive, append = connection.socket.recv, self._buffer.append
        ending = connection.ending
        try:
            while packet := receive(LARGEST_PACKET):
                if ending and packet.endswith(ending) and len(packet) > NUMBER_BYTES:
                    append(packet)
                else:
                    self._sort(connection, packet)
                    ending = connection.ending
        except BlockingIOError:
            return False
        except OSError:
            pass
        return True

    def _sort(self, connection: _Connection, packet: bytes) -> None:
        """A packet that may have to wait, or that is no message."""
        if connection.publisher is None:
            self._greet(connection, packet)
            return
        if len(packet) < NUMBER_BYTES:  # no publisher of ours
            connection.socket.shutdown(SHUT_RDWR)
            return
        number = number_of(packet)
        if len(packet) == NUMBER_BYTES:
            connection.skipped.add(number)
        elif number <= connection.taken:
            connection.ending = packet[-NUMBER_BYTES:]
            self._buffer.append(packet)
        else:
            if not connection.held:
                due_ns = time.monotonic_ns() + int(self._longest_wait_s * _NS_PER_S)
                arm_timer(self._timer_fd, due_ns, 0)
            connection.held.append(packet)

    def _greet(self, connection: _Connection, packet: bytes) -> None:
        publisher = greeted_by(packet)
        if publisher is None:
            connection.socket.shutdown(SHUT_RDWR)
            return
        before = self._by_publisher.get(publisher)
        if before is not None:  # the same publisher has connected again
            self._read_all(before)
            self._release(before, None)
        connection.publisher = publisher
        connection.taken = before.taken if before else self._taken.pop(publisher, 0)
        self._by_publisher[publisher] = connection

    def _forget(self, connection: _Connection) -> None:
        connection.socket.close()
        self._connections.remove(connection)
        publisher = connection.publisher
        self._release(connection, None)
        if publisher is not None and self._by_publisher.get(publisher) is connection:
            del self._by_publisher[publisher]
            self._remember(publisher, connection.taken)

    def _merge(self, sample: Sample) -> None:
        """Put a message of DDS into the buffer, between the packets of its publisher."""
        connection = self._by_publisher.get(sample.publisher)
        if connection is None:
            self._remember(sample.publisher, sample.number)
            self._buffer.append(sample.data)
            return
        # All that was sent before the message is there now.
        self._read_all(connection)
        if sample.number in connection.skipped:
            connection.skipped.discard(sample.number)
        else:
            self._buffer.append(sample.data)
        self._release(connection, sample.number)

    def _release(self, connection: _Connection, taken: int | None) -> None:
        """Let the packets pass that wait for messages of DDS up to `taken`; None: all."""
        held = connection.held
        while held and (taken is None or number_of(held[0]) <= taken):
            connection.taken = max(connection.taken, number_of(held[0]))
            self._buffer.append(held.popleft())
        connection.taken = max(connection.taken, taken or 0)

    def _release_all(self) -> bool:
        with suppress(BlockingIOError):
            os.read(self._timer_fd, 8)
        with self._lock:
            for connection in self._connections:
                self._release(connection, None)
        return self.deliver()

    def _remember(self, publisher: bytes, number: int) -> None:
        self._taken.pop(publisher, None)
        self._taken[publisher] = number
        if len(self._taken) > _REMEMBERED:
            del self._taken[next(iter(self._taken))]


def open_receiver(
    node: Node, subscription: Subscription, buffer: MessageBuffer
) -> LocalReceiver | None:
    """The receiver of a subscription; None if it takes everything of other processes from DDS.

    Args:
        node: of the subscription.
        subscription: of rclpy; not destroyed.
        buffer: of the subscription.
    """
    folder = socket_folder()
    gid = None if folder is None else _gid_of(node, subscription)
    if folder is None or gid is None:
        return None
    try:
        return LocalReceiver(folder, gid, buffer, DdsReader(subscription.handle))
    except OSError:  # the run has ended, or its file system has no sockets
        return None


def _gid_of(node: Node, subscription: Subscription) -> bytes | None:
    """The GID of a node's subscription; None if the graph has further ones of its name here.

    Fast DDS numbers the entities of a participant in the order of their creation.
    """
    topic = subscription.handle.get_topic_name()
    own = [other for other in node.subscriptions if _topic_of(other) == topic]
    name = (node.get_name(), node.get_namespace())
    # Every node has a publisher: that of its parameters' events.
    participant = participant_of(publisher_gid(next(iter(node.publishers)).handle))
    gids = sorted(
        end.gid
        for end in subscriptions_of(node.handle, topic)
        if end.node == name and participant_of(end.gid) == participant
    )
    return gids[own.index(subscription)] if len(gids) == len(own) else None


def _topic_of(subscription: Subscription) -> str | None:
    try:
        return str(subscription.handle.get_topic_name())
    except InvalidHandle:
        return None
