"""The inbox of a subscription: what waits for what, for how long, and what is dropped."""

import fcntl
import gc
import mmap
import os
import resource
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from socket import send_fds, socket

import pytest

from obelisk_spec.local_transport import inbox as inbox_module
from obelisk_spec.local_transport.inbox import PublisherInbox
from obelisk_spec.local_transport.sockets import (
    CONFIRMATION,
    LARGEST_MESSAGE,
    STAMP_BYTES,
    Greeting,
    SocketFolder,
    new_page,
    packed_number,
    packed_stamp,
)

GID = bytes(16)
PUBLISHER, OTHER = bytes(range(16)), bytes(range(1, 17))
DEPTH = 10


class Publisher:
    """A publisher's end of a connection; it has sent some packets before."""

    def __init__(self, folder: SocketFolder, gid: bytes, packets: int) -> None:
        connection = folder.connect(GID, DEPTH)
        assert connection is not None
        self.socket: socket = connection
        descriptor, self.page = new_page()
        greeting = bytes(Greeting(publisher=gid, packets=packets))
        send_fds(connection, [greeting], [descriptor])
        os.close(descriptor)

    def send(self, text: str, *, packets: int, after: int) -> None:
        """Send a message, the publisher's `packets`-th packet, after this number through DDS."""
        self.socket.send(text.encode() + packed_stamp(0, packets, after))

    def close(self) -> None:
        self.socket.close()
        self.page.release()

    def skip(self, number: int) -> None:
        """A packet has already delivered the message with this number in DDS."""
        self.page[1] = number
        self.socket.send(packed_number(number))


class Subscription:
    """An inbox and what it has delivered."""

    def __init__(self, folder: SocketFolder, *, is_reliable: bool) -> None:
        self.got: list[str] = []
        self._folder = folder
        self._publishers: list[Publisher] = []
        self.inbox = PublisherInbox(
            folder,
            GID,
            depth=DEPTH,
            is_reliable=is_reliable,
            put=lambda packet: self.got.append(packet[:-STAMP_BYTES].decode()),
            on_connect=lambda _connection: None,
        )

    def connect(self, gid: bytes = PUBLISHER) -> Publisher:
        publisher = self.connect_unread(gid)
        self.read()
        return publisher

    def connect_unread(self, gid: bytes = PUBLISHER, packets: int = 0) -> Publisher:
        self._publishers.append(Publisher(self._folder, gid, packets))
        return self._publishers[-1]

    def read(self) -> None:
        """Read all sockets; the end of a connection is noticed when no packets are left."""
        self.inbox.accept()
        for connection in self.inbox.connections * 2:
            if connection.socket.fileno() >= 0 and self.inbox.read(connection):
                self.inbox.forget(connection)

    def take_from_dds(self, text: str, number: int, gid: bytes = PUBLISHER) -> None:
        self.inbox.merge(gid, number, lambda _packets: self.got.append(text))

    def release(self, late_s: float) -> None:
        """Release what has waited long enough, some time after it was due."""
        self.inbox.release(self.inbox.next_release_s + late_s)

    def close(self) -> None:
        for publisher in self._publishers:
            publisher.close()
        self.inbox.close()


@pytest.fixture
def folder(tmp_path: Path) -> SocketFolder:
    tmp_path.chmod(0o700)
    return SocketFolder(str(tmp_path))


@pytest.fixture
def make(folder: SocketFolder) -> Iterator[Callable[..., Subscription]]:
    """Make subscriptions, one at a time."""
    made: list[Subscription] = []

    def make(*, is_reliable: bool = True) -> Subscription:
        made.append(Subscription(folder, is_reliable=is_reliable))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.fixture
def subscription(make: Callable[..., Subscription]) -> Subscription:
    return make()


def test_a_publisher_of_another_user_is_disconnected(
    subscription: Subscription, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inbox_module, "peer_process", lambda _connection: None)
    publisher = subscription.connect()
    assert subscription.inbox.connections == []
    with pytest.raises(ConnectionResetError):
        publisher.socket.recv(100)


def sealed(size: int) -> int:
    descriptor = os.memfd_create("page", os.MFD_ALLOW_SEALING)
    os.ftruncate(descriptor, size)
    fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK)
    return descriptor


def unsealed() -> int:
    """A page whose second number claims that a packet is missing."""
    descriptor = os.memfd_create("page")
    os.write(descriptor, packed_number(0) + packed_number(9) + bytes(mmap.PAGESIZE - 16))
    return descriptor


@pytest.mark.parametrize(
    "opened",
    [
        lambda: os.open(os.devnull, os.O_RDWR),
        lambda: sealed(mmap.PAGESIZE - 1),
        unsealed,
    ],
    ids=["no memory", "too small", "can be removed"],
)
def test_a_page_whose_memory_is_not_guaranteed_is_not_read(
    subscription: Subscription, folder: SocketFolder, opened: Callable[[], int]
) -> None:
    """Otherwise, another program could end this one with SIGBUS."""
    descriptor = opened()
    connection = folder.connect(GID, DEPTH)
    assert connection is not None
    with connection:
        greeting = bytes(Greeting(publisher=PUBLISHER, packets=0))
        send_fds(connection, [greeting], [descriptor])
        os.close(descriptor)
        connection.send(b"a" + packed_stamp(0, 1, 0))
        subscription.read()
        subscription.take_from_dds("b", 1)
        assert subscription.got == ["a", "b"]


def test_the_largest_message_is_received_whole(subscription: Subscription) -> None:
    text = "a" * LARGEST_MESSAGE
    subscription.connect().send(text, packets=1, after=0)
    subscription.read()
    assert subscription.got == [text]


def test_only_the_first_message_from_dds_is_confirmed(subscription: Subscription) -> None:
    publisher = subscription.connect()
    with pytest.raises(BlockingIOError):
        publisher.socket.recv(100)
    subscription.take_from_dds("a", 1)
    assert publisher.socket.recv(100) == CONFIRMATION
    subscription.take_from_dds("b", 2)
    with pytest.raises(BlockingIOError):
        publisher.socket.recv(100)


@pytest.mark.parametrize("is_connected", [True, False], ids=["connected", "disconnected"])
def test_a_message_from_dds_that_was_given_up_does_not_arrive_later(
    subscription: Subscription, is_connected: bool
) -> None:
    publisher = subscription.connect()
    publisher.send("c", packets=1, after=2)
    subscription.read()
    subscription.release(0.1)
    if not is_connected:
        publisher.socket.close()
        subscription.read()
    for number in (1, 2):
        subscription.take_from_dds("late", number)
    subscription.take_from_dds("d", 3)
    assert subscription.got == ["c", "d"]


def test_packets_that_wait_for_dds_outlive_their_connection(subscription: Subscription) -> None:
    publisher = subscription.connect()
    publisher.send("b", packets=1, after=1)
    publisher.close()
    subscription.read()
    subscription.take_from_dds("a", 1)
    assert subscription.got == ["a", "b"]
    assert subscription.inbox.connections == []


def test_a_message_from_dds_does_not_wait_for_packets_of_a_publisher_that_ended(
    subscription: Subscription,
) -> None:
    publisher = subscription.connect()
    publisher.page[0] = 3  # these packets are still waiting in the publisher
    subscription.take_from_dds("d", 1)
    assert subscription.got == []
    publisher.socket.close()
    subscription.read()
    assert subscription.got == ["d"]


def test_packets_that_wait_for_dds_have_arrived(subscription: Subscription) -> None:
    publisher = subscription.connect()
    publisher.send("b", packets=1, after=1)
    subscription.read()
    publisher.page[0] = 1
    subscription.take_from_dds("a", 1)
    subscription.take_from_dds("c", 2)
    assert subscription.got == ["a", "b", "c"]


def test_messages_from_dds_do_not_wait_after_one_is_dropped(subscription: Subscription) -> None:
    publisher = subscription.connect()
    publisher.send("a", packets=1, after=0)
    publisher.skip(1)
    subscription.take_from_dds("a", 1)
    subscription.take_from_dds("b", 2)
    assert subscription.got == ["a", "b"]


def test_nothing_waits_for_a_lost_notice_to_drop_a_message(subscription: Subscription) -> None:
    publisher = subscription.connect()
    publisher.page[1] = 1
    publisher.send("b", packets=2, after=1)
    subscription.take_from_dds("a", 1)
    assert subscription.got == ["a", "b"]


def test_everything_that_waits_can_be_released_after_a_stop(subscription: Subscription) -> None:
    first, second = subscription.connect(), subscription.connect(OTHER)
    first.send("a", packets=1, after=1)
    second.page[0] = 1
    subscription.take_from_dds("b", 1, OTHER)
    subscription.inbox.stop()
    subscription.inbox.release()
    assert sorted(subscription.got) == ["a", "b"]


def open_descriptors() -> int:
    gc.collect()  # sockets of earlier tests
    return len(list(Path("/proc/self/fd").iterdir()))


def test_without_descriptors_for_its_page_a_publisher_is_disconnected(
    subscription: Subscription,
) -> None:
    before = open_descriptors()
    publisher = subscription.connect_unread()
    subscription.inbox.accept()
    lowest = os.dup(publisher.socket.fileno())
    os.close(lowest)
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (lowest + 1, limits[1]))
    try:
        subscription.read()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert subscription.inbox.connections == []
    publisher.close()
    assert open_descriptors() == before


def test_a_publisher_that_leaves_keeps_no_descriptors(subscription: Subscription) -> None:
    before = open_descriptors()
    subscription.connect().close()
    subscription.read()
    assert open_descriptors() == before


class Reconnected:
    """A publisher that lost its connection and has just connected again."""

    def __init__(self, subscription: Subscription, before: Publisher, packets: int = 0) -> None:
        before.socket.close()
        self.publisher = subscription.connect_unread(packets=packets)
        self._subscription = subscription

    def read(self) -> None:
        """Read the new socket first."""
        inbox = self._subscription.inbox
        inbox.accept()
        inbox.read(inbox.connections[-1])


def test_messages_of_a_lost_connection_precede_those_of_the_next(
    subscription: Subscription,
) -> None:
    before = subscription.connect()
    before.send("a", packets=1, after=0)
    again = Reconnected(subscription, before)
    again.publisher.send("b", packets=2, after=0)
    again.read()
    assert subscription.got == ["a", "b"]


@pytest.mark.parametrize("is_taken", [True, False], ids=["taken", "waiting"])
def test_the_order_of_dds_and_packets_survives_a_lost_connection(
    subscription: Subscription, is_taken: bool
) -> None:
    before = subscription.connect()
    before.page[0] = 0 if is_taken else 1  # waits for a packet that was never sent
    subscription.take_from_dds("a", 1)
    assert subscription.got == (["a"] if is_taken else [])
    again = Reconnected(subscription, before)
    again.publisher.send("b", packets=1, after=1)
    again.read()
    assert again.publisher.socket.recv(100) == CONFIRMATION
    assert subscription.got == ["a", "b"]
    subscription.read()
    again.publisher.send("d", packets=2, after=2)
    subscription.take_from_dds("c", 2)
    assert subscription.got == ["a", "b", "c", "d"]


def test_packets_that_wait_for_dds_survive_a_lost_connection(subscription: Subscription) -> None:
    before = subscription.connect()
    before.send("b", packets=1, after=1)
    subscription.read()
    again = Reconnected(subscription, before)
    again.read()
    subscription.take_from_dds("a", 1)
    assert subscription.got == ["a", "b"]
    assert subscription.inbox.next_release_s == float("inf")


def test_a_message_to_drop_is_known_after_a_lost_connection(subscription: Subscription) -> None:
    before = subscription.connect()
    before.send("a", packets=1, after=0)
    before.send("b", packets=2, after=0)
    before.skip(1)
    subscription.read()
    Reconnected(subscription, before, packets=1).read()
    subscription.take_from_dds("b", 1)
    subscription.take_from_dds("c", 2)
    assert subscription.got == ["a", "b", "c"]


@pytest.mark.parametrize("is_reliable", [True, False], ids=["reliable", "best effort"])
def test_a_reliable_subscription_waits_longer(
    make: Callable[..., Subscription], is_reliable: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inbox_module, "_RELIABLE_WAIT_S", 2000.0)
    monkeypatch.setattr(inbox_module, "_BEST_EFFORT_WAIT_S", 1000.0)
    subscription = make(is_reliable=is_reliable)
    subscription.connect().send("b", packets=1, after=1)
    before_s = time.monotonic()
    subscription.read()
    wait_s = 2000.0 if is_reliable else 1000.0
    assert before_s + wait_s <= subscription.inbox.next_release_s <= time.monotonic() + wait_s


@pytest.mark.parametrize("is_reliable", [True, False], ids=["reliable", "best effort"])
def test_packets_wait_again_after_a_suspension_but_not_after_a_busy_callback(
    make: Callable[..., Subscription], is_reliable: bool
) -> None:
    """DDS was suspended, too, so what is missing may still arrive."""
    subscription = make(is_reliable=is_reliable)
    subscription.connect().send("b", packets=1, after=1)
    subscription.read()
    resumed_s = subscription.inbox.next_release_s + 10.0
    subscription.inbox.release(resumed_s)
    assert subscription.got == []
    assert subscription.inbox.next_release_s > resumed_s
    subscription.release(0.9)
    assert subscription.got == ["b"]
    assert subscription.inbox.next_release_s == float("inf")


def test_each_publisher_has_its_own_wait(subscription: Subscription) -> None:
    first, second = subscription.connect(), subscription.connect(OTHER)
    first.send("first", packets=1, after=1)
    subscription.read()
    due_s = subscription.inbox.next_release_s
    second.send("second", packets=1, after=1)
    subscription.read()
    subscription.inbox.release(due_s)
    assert subscription.got == ["first"]
    assert subscription.inbox.next_release_s > due_s


def test_the_wait_starts_anew_with_each_message(subscription: Subscription) -> None:
    publisher = subscription.connect()
    publisher.send("c", packets=1, after=2)
    publisher.send("e", packets=2, after=3)
    subscription.read()
    due_s = [subscription.inbox.next_release_s]
    for text, number in (("a", 1), ("b", 2)):
        subscription.take_from_dds(text, number)
        due_s.append(subscription.inbox.next_release_s)
    assert subscription.got == ["a", "b", "c"]
    assert due_s[0] < due_s[1] < due_s[2] < float("inf")
