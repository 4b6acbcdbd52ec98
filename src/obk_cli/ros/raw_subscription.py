"""Raw subscriptions: serialized messages of a topic, taken without an executor.

Messages wait in the subscription until `RawSubscription.take`. The subscription requests the
strongest QoS that all publishers offer, and is replaced when a weaker one appears. `DropCounter`
counts gaps in the publisher's sequence numbers.
"""

import os
import select
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from obelisk_spec.local_transport.dds_reader import DdsReader, Sample
from obelisk_spec.local_transport.inbox import Connection, PublisherInbox
from obelisk_spec.local_transport.sockets import STAMP_BYTES, SocketFolder, stamp_of
from obelisk_spec.runtime_protocol import LOCAL_TRANSPORT_OFF, LOCAL_TRANSPORT_VARIABLE
from obelisk_spec.suggestions import with_number
from obk_cli.errors import CommandFailedError
from obk_cli.ros.types import require_message

__all__ = [
    "DropCounter",
    "OfferedQos",
    "RawSubscription",
    "RequestedQos",
    "Tap",
    "arrived",
    "messages",
    "offered_qos",
    "requested_qos",
]


DEPTH: Final = 1000
"""Maximum number of waiting messages of a topic: one second at 1 kHz."""


class Tap:
    """The messages of a raw subscription, from its socket and from DDS; use from one thread."""

    def __init__(self, folder: SocketFolder, gid: bytes, handle: Any, depth: int) -> None:
        """Open the socket.

        Args:
            folder: the socket folder of the run.
            gid: GID of the subscription.
            handle: rclpy's handle of the subscription.
            depth: maximum number of waiting messages.

        Raises:
            OSError: the socket cannot be created in the folder.
        """
        self._waiting: deque[tuple[bytes, Mapping[str, int]]] = deque(maxlen=depth)
        self._inbox = PublisherInbox(
            folder,
            gid,
            depth=depth,
            is_reliable=True,
            put=self._put,
            on_connect=self._watch,
        )
        self._reader = DdsReader(handle)
        self._is_without_connection = False
        self._dds_received_ns = 0
        """Time of receipt of the message from DDS for which the next packets have waited."""
        self._connections: dict[int, Connection] = {}
        self._epoll = select.epoll()
        self._epoll.register(self._inbox.listener, select.EPOLLIN)

    def take(self) -> tuple[bytes, Mapping[str, int]] | None:
        """The oldest message with its times and its number; None if there is none.

        The number counts all messages of the publisher, over sockets and DDS. It is 0 if the
        publisher has just connected, because earlier packets to others are unknown.
        """
        if not self._waiting:
            self._read()
        if not self._waiting and (sample := self._reader.take()) is not None:
            put = partial(self._put_sample, sample)
            self._dds_received_ns = 0
            self._inbox.merge(sample.publisher, sample.number, put)
        elif not self._waiting and (now_s := time.monotonic()) > self._inbox.next_release_s:
            self._inbox.release(now_s)
        return self._waiting.popleft() if self._waiting else None

    def release(self) -> None:
        """Stop waiting for messages from DDS: `take` then returns the packets that follow them."""
        self._inbox.release()

    def close(self) -> None:
        """Close the socket; DDS delivers messages from now on."""
        self._inbox.stop()
        self._inbox.close()
        self._reader.close()
        self._epoll.close()

    def _read(self) -> None:
        for fd, _ in self._epoll.poll(0):
            if fd in self._connections:
                connection = self._connections[fd]
                self._dds_received_ns = 0
                if self._inbox.read(connection):
                    del self._connections[fd]
                    self._epoll.unregister(fd)
                    self._inbox.forget(connection)
            else:
                self._inbox.accept()

    def _watch(self, connection: Connection) -> None:
        self._connections[connection.socket.fileno()] = connection
        self._epoll.register(connection.socket, select.EPOLLIN)

    def _put(self, packet: bytes) -> None:
        stamp = stamp_of(packet)
        number = self._numbered(stamp.packets + stamp.number)
        # A packet arrives within the call that publishes it. It is read up to one period of the
        # caller later; this delay must not appear as the topic's age or jitter. If the packet had
        # to wait for an earlier message from DDS, it counts as received with that message, because
        # recordings are sorted by the time of receipt.
        received_ns = max(stamp.published_ns, self._dds_received_ns)
        info = _info(stamp.published_ns, received_ns, number)
        self._waiting.append((packet[:-STAMP_BYTES], info))

    def _put_sample(self, sample: Sample, packets: int | None) -> None:
        if packets is None:
            self._is_without_connection = True
            number = sample.number
        else:
            number = self._numbered(packets + sample.number)
        info = _info(sample.published_ns, sample.received_ns, number)
        self._waiting.append((sample.data, info))
        self._dds_received_ns = sample.received_ns

    def _numbered(self, number: int) -> int:
        """The number of a message of a connected publisher; 0 if the last one omitted packets."""
        if self._is_without_connection:
            self._is_without_connection = False
            return 0
        return number


def _info(published_ns: int, received_ns: int, number: int) -> Mapping[str, int]:
    """Message info as in rclpy."""
    return {
        "source_timestamp": published_ns,
        "received_timestamp": received_ns,
        "publication_sequence_number": number,
    }


def open_tap(gids: Collection[bytes], handle: Any, depth: int) -> Tap | None:
    """Open the tap of a new subscription; None without a run or without local transport.

    Args:
        gids: possible GIDs of the subscription.
        handle: rclpy's handle of the subscription.
        depth: its history depth.
    """
    path = os.environ.get(LOCAL_TRANSPORT_VARIABLE, LOCAL_TRANSPORT_OFF)
    if len(gids) == 1 and path != LOCAL_TRANSPORT_OFF:
        with suppress(OSError):  # the run has ended, or its folder is not private
            (gid,) = gids
            return Tap(SocketFolder(path), gid, handle, depth)
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class OfferedQos:
    """The QoS of one publisher, as named in rmw: `keep_last`, `reliable`."""

    history: str
    depth: int
    reliability: str
    durability: str
    liveliness: str
    deadline_ns: int
    lifespan_ns: int
    lease_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class RequestedQos:
    """The QoS that a subscription requests."""

    is_reliable: bool = True
    is_transient_local: bool = False
    """Whether messages published earlier are also requested."""


def requested_qos(offers: Collection[OfferedQos], *, is_light: bool = False) -> RequestedQos:
    """The strongest QoS that all publishers offer; without publishers, that of Obelisk's nodes.

    Args:
        offers: one per publisher.
        is_light: let publishers send each message once, without acknowledgment: a third less
            work. Reliable delivery is still used if earlier messages are requested.
    """
    request = RequestedQos(
        is_reliable=all(offer.reliability == "reliable" for offer in offers),
        is_transient_local=bool(offers)
        and all(offer.durability == "transient_local" for offer in offers),
    )
    return (
        request if request.is_transient_local or not is_light else RequestedQos(is_reliable=False)
    )


class DropCounter:
    """Counts the messages of one topic and the gaps in their publisher's sequence numbers."""

    __slots__ = ("_last", "count", "dropped")

    def __init__(self) -> None:
        """Start at zero; messages published before the first received one are not counted."""
        self.count = 0
        self.dropped = 0
        self._last = 0

    def take(self, sequence: int, publishers: int) -> None:
        """Count a message.

        Args:
            sequence: its sequence number from its publisher, from 1.
            publishers: number of publishers; numbers of several interleave and show no gaps.
        """
        self.count += 1
        # A restarted publisher counts from 1 again.
        if self._last and publishers == 1 and sequence > self._last:
            self.dropped += sequence - self._last - 1
        self._last = sequence


class RawSubscription:
    """A raw subscription to one topic."""

    def __init__(
        self, node: Any, name: str, msg_type: str, python_type: Any, *, is_light: bool = False
    ) -> None:
        """Subscribe.

        Args:
            node: rclpy's node handle.
            name: full name.
            msg_type: full, `pkg/msg/Name`.
            python_type: the message's class.
            is_light: cause little load for publishers; see `requested_qos`.

        Raises:
            CommandFailedError: messages of the class cannot be received here.
        """
        from rclpy.impl.implementation_singleton import rclpy_implementation
        from rclpy.topic_endpoint_info import TopicEndpointInfo

        require_message(python_type)
        self.name: Final = name
        self.msg_type: Final = msg_type
        self.python_type: Final = python_type
        self.publishers = 0
        """Number of publishers at the last check."""
        self.hashes: tuple[str, ...] = ()
        """Type hashes of the publishers."""
        self.offers: tuple[OfferedQos, ...] = ()
        self._node = node
        self._is_light = is_light
        self._functions = rclpy_implementation
        self._end: Any = TopicEndpointInfo
        self._has_taken = False
        self.learn()
        self._request = requested_qos(self.offers, is_light=is_light)
        self._tap: Tap | None = None
        self._subscription = self._subscribe()

    def learn(self) -> None:
        """Check the publishers."""
        with self._node:
            infos = self._functions.rclpy_get_publishers_info_by_topic(self._node, self.name, False)
        ends = [self._end(**info) for info in infos]
        self.publishers = len(ends)
        self.offers = tuple(offered_qos(end.qos_profile) for end in ends)
        self.hashes = tuple(str(end.topic_type_hash) for end in ends)

    def refresh(self) -> None:
        """Check the publishers, and resubscribe if their QoS requires it.

        Do not call this while messages are being taken.
        """
        self.learn()
        request = requested_qos(self.offers, is_light=self._is_light)
        # Earlier messages are requested only until a message arrives, to avoid duplicates.
        is_weaker = self._request.is_reliable and not request.is_reliable
        is_latched = request.is_transient_local and not self._request.is_transient_local
        if self.offers and (is_weaker or (is_latched and not self._has_taken)):
            self.close()
            self._request = request
            self._subscription = self._subscribe()

    def take(self) -> Iterator[tuple[bytes, Mapping[str, int]]]:
        """The waiting messages, serialized, each with its times and number.

        At most one queue of messages, so that one topic does not delay others.
        """
        take = (
            partial(self._subscription.take_message, self.python_type, True)
            if self._tap is None
            else self._tap.take
        )
        for _ in range(DEPTH):
            taken = take()
            if taken is None:
                return
            self._has_taken = True
            yield taken

    def take_last(self) -> Iterator[tuple[bytes, Mapping[str, int]]]:
        """Like `take`, at the end: also the messages that wait for earlier ones from DDS.

        These may never arrive, because a publisher that ends sends nothing again.
        """
        yield from self.take()
        if self._tap is not None:
            self._tap.release()
            yield from self.take()

    def close(self) -> None:
        """Unsubscribe."""
        if self._tap is not None:
            self._tap.close()
            self._tap = None
        self._subscription.destroy_when_not_in_use()

    def _subscribe(self) -> Any:
        qos = _profile(self._request).get_c_qos_profile()
        before = self._own_gids()
        with self._node:
            made = self._functions.Subscription(self._node, self.python_type, self.name, qos)
        if not self._request.is_transient_local:
            self._tap = open_tap(self._own_gids() - before, made, DEPTH)
        return made

    def _own_gids(self) -> set[bytes]:
        """The GIDs of this process's subscriptions to the topic."""
        with self._node:
            own = self._node.get_node_name(), self._node.get_namespace()
            ask = self._functions.rclpy_get_subscriptions_info_by_topic
            ends = ask(self._node, self.name, False)
        return {
            bytes(end["endpoint_gid"])
            for end in ends
            if (end["node_name"], end["node_namespace"]) == own
        }


def _profile(request: RequestedQos) -> Any:
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    reliability, durability = ReliabilityPolicy, DurabilityPolicy
    return QoSProfile(  # type: ignore[no-untyped-call]
        depth=DEPTH,
        reliability=reliability.RELIABLE if request.is_reliable else reliability.BEST_EFFORT,
        durability=(
            durability.TRANSIENT_LOCAL if request.is_transient_local else durability.VOLATILE
        ),
    )


def offered_qos(qos: Any) -> OfferedQos:
    """Convert an rclpy QoS profile to a value."""
    return OfferedQos(
        history=qos.history.name.lower(),
        depth=qos.depth,
        reliability=qos.reliability.name.lower(),
        durability=qos.durability.name.lower(),
        liveliness=qos.liveliness.name.lower(),
        deadline_ns=qos.deadline.nanoseconds,
        lifespan_ns=qos.lifespan.nanoseconds,
        lease_ns=qos.liveliness_lease_duration.nanoseconds,
    )


POLL_S: Final = 0.002
REFRESH_S: Final = 0.1
"""Polling period of the publishers [s]."""


def messages(
    raw: RawSubscription, drops: DropCounter, timeout_s: float, *, each: bool
) -> Iterator[Any]:
    """Yield messages without end; see `serialized`."""
    for data in serialized(raw, drops, timeout_s, each=each):
        yield deserialized(data, raw)


def deserialized(data: bytes, raw: RawSubscription) -> Any:
    """Deserialize a message of a topic.

    Raises:
        CommandFailedError: the bytes are not such a message; types are matched by name only.
    """
    from rclpy.serialization import deserialize_message

    try:
        return deserialize_message(data, raw.python_type)
    except Exception as error:  # the middleware has no specific class for it
        raise CommandFailedError(
            f"a message on {raw.name} does not match {raw.msg_type} as built here",
            help="its publisher may use another definition of the type: build both from the same",
        ) from error


def serialized(
    raw: RawSubscription, drops: DropCounter, timeout_s: float, *, each: bool
) -> Iterator[bytes]:
    """Yield serialized messages without end.

    Args:
        raw: the subscription to the topic.
        drops: counts messages and losses.
        timeout_s: limit for the first message [s].
        each: whether the limit also applies to each later message.

    Raises:
        CommandFailedError: no message arrives in time.
    """
    last_received = last_refresh = time.monotonic()
    while True:
        for data, info in raw.take():
            drops.take(info["publication_sequence_number"], raw.publishers)
            last_received = time.monotonic()
            yield data
        now = time.monotonic()
        if now > last_received + timeout_s and (each or not drops.count):
            raise CommandFailedError(
                f"no message received on {raw.name} within {timeout_s:g} s",
                help=f"it has {with_number(raw.publishers, 'publisher')}: "
                f"`obk topic info {raw.name}` shows them, `obk lifecycle get` whether their nodes "
                "are active",
            )
        if now > last_refresh + REFRESH_S:
            last_refresh = now
            raw.refresh()
        time.sleep(POLL_S)


def arrived(
    raw: RawSubscription, is_wanted: Callable[[int], bool] = lambda _: True
) -> Iterator[tuple[int, Any]]:
    """Yield each waiting message with its time of receipt [ns since 1970].

    Args:
        raw: the subscription to the topic.
        is_wanted: called with the time of receipt; unwanted messages are skipped unread.
    """
    for data, info in raw.take():
        received_ns = info["received_timestamp"]
        if is_wanted(received_ns):
            yield received_ns, deserialized(data, raw)
