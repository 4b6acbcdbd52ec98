"""Receive a subscription's messages from local sockets, on the worker that runs it."""

import os
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from math import inf
from typing import Any, Final

from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy
from rclpy.subscription import Subscription

from obelisk_py.core.executor.rcl_listeners import arm_timer, open_timer
from obelisk_py.core.executor.worker import ReadyCallback, Worker
from obelisk_py.core.intra_process import MessageBuffer
from obelisk_py.core.local_sender import socket_folder, subscriptions_of
from obelisk_spec.local_transport.dds_reader import DdsReader, participant_of, publisher_gid
from obelisk_spec.local_transport.inbox import Connection, PublisherInbox
from obelisk_spec.local_transport.sockets import SocketFolder

__all__ = ["LocalReceiver", "open_receiver"]

_NS_PER_S: Final = 1_000_000_000


class LocalReceiver:
    """The socket inbox of a subscription; one worker runs it, any thread may call `take`."""

    group: CallbackGroup | None = None
    waits_for_group = False
    is_awaited = False

    def __init__(
        self, folder: SocketFolder, gid: bytes, buffer: MessageBuffer, reader: DdsReader
    ) -> None:
        """Open the socket, so that publishers can connect.

        Args:
            folder: the run's socket folder.
            gid: the subscription's GID.
            buffer: the subscription's buffer, which receives the packets.
            reader: reads the subscription's messages from DDS.

        Raises:
            OSError: the socket cannot be created in the folder.
        """
        self._inbox = PublisherInbox(
            folder,
            gid,
            depth=buffer.qos.depth,
            is_reliable=buffer.qos.reliability == ReliabilityPolicy.RELIABLE,
            put=buffer.append,
            on_connect=self._watch,
            on_wait=self._wait,
        )
        self._buffer = buffer
        self._reader = reader
        self._timer_fd = open_timer(time.CLOCK_MONOTONIC)
        self._worker: Worker | None = None
        self._is_open = True
        self._lock = threading.Lock()
        self.deliver: Callable[[], bool] = self._wake
        """Called when the buffer has new messages; returns whether a user callback ran."""

    def ready_callbacks(self, worker: Worker) -> Mapping[int, ReadyCallback]:
        """The handlers of the socket and the timer; new connections are added to the worker."""
        self._worker = worker
        return {
            self._inbox.listener.fileno(): self._accept,
            self._timer_fd: self._release,
        }

    def take(self) -> tuple[Any, Any] | None:
        """Take the next message with its info, from a publisher on this host or from DDS."""
        buffer = self._buffer
        while True:
            taken = buffer.take()
            if taken is not None:
                return taken
            with self._lock:
                mark = buffer.dds_mark
                if not self._take_sample():
                    buffer.mark_dds_empty(mark)
                    return None

    def stop(self) -> None:
        """Stop publishers from sending, and put everything already sent into the buffer."""
        with self._lock:
            self._is_open = False
            self._inbox.stop()
            while self._take_sample():  # also what precedes the latest packets
                pass
            self._inbox.release()

    def close(self) -> None:
        """Close all descriptors; call this when no worker watches them any more."""
        with self._lock:
            self._inbox.close()
            self._reader.close()
            os.close(self._timer_fd)

    def _take_sample(self) -> bool:
        """Merge the oldest message from DDS into the order; false if DDS has none."""
        sample = self._reader.take()
        if sample is not None:
            self._inbox.merge(sample.publisher, sample.number, partial(self._put, sample.data))
        return sample is not None

    def _put(self, data: bytes, _packets: int | None) -> None:
        self._buffer.append(data)

    def _wake(self) -> bool:
        self._buffer.wake()
        return False

    def _wait(self) -> None:
        """Set the timer for the messages that are the first to have waited long enough."""
        arm_timer(self._timer_fd, int(self._inbox.next_release_s * _NS_PER_S) + 1, 0)

    def _accept(self) -> bool:
        with self._lock:
            if self._is_open:
                self._inbox.accept()
        return False

    def _watch(self, connection: Connection) -> None:
        if self._worker is not None and self._is_open:
            fd = connection.socket.fileno()
            self._worker.watch(self, fd, partial(self._read, self._worker, connection))

    def _read(self, worker: Worker, connection: Connection) -> bool:
        with self._lock:
            if self._inbox.read(connection) and self._is_open:
                worker.unwatch(connection.socket.fileno())
                self._inbox.forget(connection)
        return self.deliver()

    def _release(self) -> bool:
        with self._lock:
            while self._take_sample():
                pass
            self._inbox.release(time.monotonic())
            if self._inbox.next_release_s < inf:
                self._wait()
        return self.deliver()


def open_receiver(
    node: Node, subscription: Subscription, buffer: MessageBuffer
) -> LocalReceiver | None:
    """Open a subscription's receiver; None if all messages of other processes come from DDS.

    Args:
        node: the subscription's node.
        subscription: must not be destroyed.
        buffer: the subscription's buffer.
    """
    folder = socket_folder()
    gid = None if folder is None else _gid_of(node, subscription)
    if folder is None or gid is None:
        return None
    reader = DdsReader(subscription.handle)
    try:
        return LocalReceiver(folder, gid, buffer, reader)
    except OSError:  # the run has ended, or its file system has no sockets
        reader.close()
        return None


def _gid_of(node: Node, subscription: Subscription) -> bytes | None:
    """The GID of a node's subscription; None if it is ambiguous or being destroyed.

    Fast DDS numbers the entities of a participant in order of creation. The GID is ambiguous if the
    ROS graph lists more or fewer subscriptions of this node and topic than the node has.
    """
    topic = subscription.handle.get_topic_name()
    own = [other for other in node.subscriptions if _topic_of(other) == topic]
    name = (node.get_name(), node.get_namespace())
    # Every node has a publisher for parameter events, which is the first to be destroyed.
    publisher = next(iter(node.publishers), None)
    if publisher is None or subscription not in own:
        return None
    participant = participant_of(publisher_gid(publisher.handle))
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
