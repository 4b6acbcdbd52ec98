"""A tap: the socket of a raw subscription in a run, by which nodes need no DDS for it.

The subscription exists in DDS, for the graph. Publishers of the run on this host find its socket
and send their messages there as long as DDS has nothing else to deliver to.
"""

import os
import select
import time
from collections import deque
from collections.abc import Collection, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, Final

from obelisk_spec.local_transport.dds_reader import DdsReader, Sample
from obelisk_spec.local_transport.folder import SocketFolder
from obelisk_spec.local_transport.inbox import Connection, PublisherInbox
from obelisk_spec.local_transport.packets import STAMP_BYTES, stamp_of
from obelisk_spec.runtime_protocol import LOCAL_TRANSPORT_OFF, LOCAL_TRANSPORT_VARIABLE

__all__ = ["Tap", "open_tap"]

_LONGEST_WAIT_S: Final = 4.0
"""How long a packet waits for an earlier message of DDS, which may be lost [s]."""


class Tap:
    """The messages of a raw subscription, by its socket and from DDS; for one thread."""

    def __init__(self, folder: SocketFolder, gid: bytes, handle: Any, depth: int) -> None:
        """Open the socket.

        Args:
            folder: of the run.
            gid: of the subscription.
            handle: rclpy's, of the subscription.
            depth: messages that may wait.

        Raises:
            OSError: the folder takes no socket.
        """
        self._waiting: deque[tuple[bytes, Mapping[str, int]]] = deque(maxlen=depth)
        self._inbox = PublisherInbox(
            folder,
            gid,
            depth=depth,
            put=self._put,
            on_connect=self._watch,
            on_wait=self._wait,
        )
        self._reader = DdsReader(handle)
        self._is_without_connection = False
        self._release_s = float("inf")
        self._connections: dict[int, Connection] = {}
        self._epoll = select.epoll()
        self._epoll.register(self._inbox.listener, select.EPOLLIN)

    def take(self) -> tuple[bytes, Mapping[str, int]] | None:
        """The oldest message with its times and its number; None if there is none.

        The number counts what the publisher has sent, by sockets and through DDS. It is 0 when the
        publisher has just connected: before, its packets to others were unknown.
        """
        if not self._waiting:
            self._read()
        if not self._waiting and (sample := self._reader.take()) is not None:
            put = partial(self._put_sample, sample)
            self._inbox.merge(sample.publisher, sample.number, put)
        elif not self._waiting and time.monotonic() > self._release_s:
            self._release_s = float("inf")
            self._inbox.release()
        return self._waiting.popleft() if self._waiting else None

    def close(self) -> None:
        """Close the socket; DDS delivers from now on."""
        self._inbox.stop()
        self._inbox.close()
        self._reader.close()
        self._epoll.close()

    def _read(self) -> None:
        for fd, _ in self._epoll.poll(0):
            if fd in self._connections:
                connection = self._connections[fd]
                if self._inbox.read(connection):
                    del self._connections[fd]
                    self._epoll.unregister(fd)
                    self._inbox.forget(connection)
            else:
                self._inbox.accept()

    def _watch(self, connection: Connection) -> None:
        self._connections[connection.socket.fileno()] = connection
        self._epoll.register(connection.socket, select.EPOLLIN)

    def _wait(self) -> None:
        self._release_s = time.monotonic() + _LONGEST_WAIT_S

    def _put(self, packet: bytes) -> None:
        stamp = stamp_of(packet)
        number = self._numbered(stamp.packets + stamp.number)
        info = _info(stamp.published_ns, time.time_ns(), number)
        self._waiting.append((packet[:-STAMP_BYTES], info))

    def _put_sample(self, sample: Sample, packets: int | None) -> None:
        if packets is None:
            self._is_without_connection = True
            number = sample.number
        else:
            number = self._numbered(packets + sample.number)
        info = _info(sample.published_ns, sample.received_ns, number)
        self._waiting.append((sample.data, info))

    def _numbered(self, number: int) -> int:
        """The number of a message of a connected publisher; 0 if the last one's omitted packets."""
        if self._is_without_connection:
            self._is_without_connection = False
            return 0
        return number


def _info(published_ns: int, received_ns: int, number: int) -> Mapping[str, int]:
    """As rclpy gives it."""
    return {
        "source_timestamp": published_ns,
        "received_timestamp": received_ns,
        "publication_sequence_number": number,
    }


def open_tap(gids: Collection[bytes], handle: Any, depth: int) -> Tap | None:
    """The tap of a new subscription; None where no run is known, or it has no local transport.

    Args:
        gids: those that may be the subscription's.
        handle: rclpy's, of the subscription.
        depth: of its history.
    """
    path = os.environ.get(LOCAL_TRANSPORT_VARIABLE, LOCAL_TRANSPORT_OFF)
    if len(gids) == 1 and path != LOCAL_TRANSPORT_OFF:
        with suppress(OSError):  # the run has ended, or its folder is not private
            (gid,) = gids
            return Tap(SocketFolder(path), gid, handle, depth)
    return None
