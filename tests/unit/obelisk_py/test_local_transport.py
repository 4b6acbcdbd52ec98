"""The local transport over real sockets: recipients and message order."""

import gc
import os
import resource
import socket
import subprocess
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from unittest.mock import MagicMock

import pytest
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Int64

from obelisk_py.core import local_sender as sender_module
from obelisk_py.core.executor.local_receiver import LocalReceiver
from obelisk_py.core.executor.worker import Worker
from obelisk_py.core.intra_process import IntraProcessPublisher, MessageBuffer, disconnect_all
from obelisk_py.core.local_sender import (
    Flusher,
    LocalSender,
    Peer,
    SubscriptionEndpoint,
    socket_folder,
)
from obelisk_py.core.serialization.codec import codec_for
from obelisk_spec.local_transport import inbox
from obelisk_spec.local_transport import sockets as sockets_module
from obelisk_spec.local_transport.dds_reader import Sample
from obelisk_spec.local_transport.sockets import (
    CONFIRMATION,
    LARGEST_MESSAGE,
    Greeting,
    SocketFolder,
    greeting_of,
    new_page,
    number_of,
    packed_number,
    packed_stamp,
    peer_process,
    stamp_of,
)
from obelisk_spec.runtime_protocol import LOCAL_TRANSPORT_OFF, LOCAL_TRANSPORT_VARIABLE

from ...waiting import eventually  # noqa: TID252 - shared by folders of tests

PUBLISHER = bytes(range(16))
DEPTH = 10
CODEC = codec_for(Int64)
assert CODEC is not None
PACK = CODEC.pack


def gid(number: int) -> bytes:
    """The address of a subscription in another process."""
    return bytes([99] * 12) + number.to_bytes(4, "big")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    folder = tmp_path / "sockets"
    folder.mkdir(mode=0o700)
    return folder


@pytest.fixture
def folder(path: Path) -> SocketFolder:
    return SocketFolder(str(path))


GREETING = Greeting(publisher=PUBLISHER, packets=3)


def stamped(message: bytes, number: int, packets: int = 1) -> bytes:
    """Build a packet."""
    return message + packed_stamp(0, packets, number)


def contents(packet: bytes) -> tuple[bytes, int]:
    """The message in a packet, and the number of messages sent through DDS before it."""
    return packet[: -len(stamped(b"", 0))], number_of(packet)


def test_other_files_in_the_folder_are_ignored(path: Path, folder: SocketFolder) -> None:
    for name in (".nfs00000000a1b2", "readme", "0-x"):
        (path / name).touch()
    with folder.listen(gid(1), DEPTH):
        assert folder.depths() == {gid(1): DEPTH}


def test_a_greeting_names_its_publisher_and_nothing_else_is_a_greeting() -> None:
    assert greeting_of(bytes(GREETING)) == GREETING
    assert greeting_of(bytes(GREETING)[:-1]) is None
    assert greeting_of(bytes(len(bytes(GREETING)))) is None


def test_a_packet_ends_with_its_stamp() -> None:
    stamp = stamp_of(b"message" + packed_stamp(1, 2, 2**40))
    assert (stamp.published_ns, stamp.packets, stamp.number) == (1, 2, 2**40)


def test_a_folder_that_others_can_enter_is_rejected(path: Path) -> None:
    path.chmod(0o701)
    before = open_descriptors()
    with pytest.raises(PermissionError, match="0700"):
        SocketFolder(str(path))
    assert open_descriptors() == before


def test_a_folder_of_another_user_is_rejected(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "getuid", lambda: path.stat().st_uid + 1)
    with pytest.raises(PermissionError):
        SocketFolder(str(path))


def test_no_socket_is_opened_after_the_run(path: Path, folder: SocketFolder) -> None:
    path.rmdir()
    before = open_descriptors()
    with pytest.raises(FileNotFoundError):
        folder.listen(gid(1), DEPTH)
    assert open_descriptors() == before


def test_the_other_process_is_known_only_if_it_belongs_to_this_user(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with near, far:
        assert peer_process(near) == os.getpid()
        other = os.getuid() + 1
        monkeypatch.setattr(os, "getuid", lambda: other)
        assert peer_process(near) is None


def test_the_folder_is_missing_without_the_variable_or_after_the_run(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv(LOCAL_TRANSPORT_VARIABLE, raising=False)
    assert socket_folder() is None
    for value in (LOCAL_TRANSPORT_OFF, str(tmp_path / "gone")):
        monkeypatch.setenv(LOCAL_TRANSPORT_VARIABLE, value)
        assert socket_folder() is None


def test_a_socket_is_reached_below_a_path_longer_than_an_address(tmp_path: Path) -> None:
    deep = tmp_path / ("a" * 100) / ("b" * 100)
    deep.mkdir(parents=True, mode=0o700)
    folder = SocketFolder(str(deep))
    with folder.listen(gid(1), DEPTH):
        connection = folder.connect(gid(1), DEPTH)
        assert connection is not None
        connection.close()


def test_leftovers_of_a_killed_process_are_not_sockets(folder: SocketFolder, path: Path) -> None:
    folder.listen(gid(1), DEPTH).close()
    assert (path / f"{gid(1).hex()}-{DEPTH}").exists()
    assert folder.connect(gid(1), DEPTH) is None
    assert folder.connect(gid(2), DEPTH) is None


def test_the_other_end_must_belong_to_the_same_user(
    folder: SocketFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sockets_module, "peer_process", lambda _connection: None)
    with folder.listen(gid(1), DEPTH):
        assert folder.connect(gid(1), DEPTH) is None


class Graph:
    """The subscriptions of the topic that DDS knows."""

    def __init__(self) -> None:
        self.endpoints: list[SubscriptionEndpoint] = []

    def add(self, number: int, *, reliable: bool = True, type_name: str = "x/msg/T") -> None:
        self.endpoints.append(
            SubscriptionEndpoint(
                gid=gid(number),
                node=("node", "/"),
                type_name=type_name,
                is_reliable=reliable,
                is_volatile=True,
            )
        )

    def remove(self, number: int) -> None:
        self.endpoints = [end for end in self.endpoints if end.gid != gid(number)]


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Graph:
    made = Graph()
    monkeypatch.setattr(sender_module, "publisher_gid", lambda _handle: PUBLISHER)
    monkeypatch.setattr(sender_module, "subscriptions_of", lambda _node, _topic: made.endpoints)
    return made


def make_sender(folder: SocketFolder, qos: QoSProfile | None = None) -> LocalSender:
    return LocalSender(
        folder,
        node_handle=None,
        handle=None,
        topic="/topic",
        type_name="x/msg/T",
        qos=qos or QoSProfile(depth=DEPTH),
    )


@pytest.fixture
def sender(folder: SocketFolder, graph: Graph) -> Iterator[LocalSender]:
    del graph
    made = make_sender(folder)
    yield made
    made.close(0.0)


def nothing() -> None:
    """Send a message through the fake DDS."""


def accepted(listener: socket.socket) -> socket.socket:
    """The connection of the only publisher, after its greeting."""
    connection, _ = listener.accept()
    connection.setblocking(False)
    greeting = greeting_of(connection.recv(100))
    assert greeting is not None
    assert greeting.publisher == PUBLISHER
    return connection


@contextmanager
def confirmed(
    sender: LocalSender, count: int, *listeners: socket.socket
) -> Iterator[list[socket.socket]]:
    """Let subscriptions confirm a DDS message; return their connections, after DDS is bypassed."""
    assert not sender.covers(count, 0)
    sender.send_through_dds(nothing)
    with ExitStack() as stack:
        connections = [stack.enter_context(accepted(listener)) for listener in listeners]
        for connection in connections:
            connection.send(CONFIRMATION)
        eventually(lambda: sender.covers(count, 0), "the bypass")
        yield connections


def test_dds_is_bypassed_once_each_has_confirmed_a_message_of_it(
    folder: SocketFolder, graph: Graph, sender: LocalSender
) -> None:
    graph.add(1)
    with folder.listen(gid(1), DEPTH) as listener:
        assert not sender.covers(1, 0)
        sender.send_through_dds(nothing)
        with accepted(listener) as connection:
            sender._next_check_s = 0.0
            assert not sender.covers(1, 0)
            connection.send(CONFIRMATION)
            eventually(lambda: sender.covers(1, 0), "the bypass")
            assert sender.send(b"message")
            assert contents(connection.recv(100)) == (b"message", 1)


def test_an_accidentally_matching_count_does_not_bypass_dds(
    folder: SocketFolder, graph: Graph, sender: LocalSender
) -> None:
    """One has a socket and is not matched yet; the matched one is outside."""
    graph.add(1)
    graph.add(2)
    with folder.listen(gid(1), DEPTH):
        assert not sender.covers(1, 0)
        sender.send_through_dds(nothing)
        assert not sender.covers(1, 0)


def test_a_listener_outside_needs_dds_until_it_leaves(
    folder: SocketFolder, graph: Graph, sender: LocalSender
) -> None:
    graph.add(1)
    with folder.listen(gid(1), DEPTH) as listener, confirmed(sender, 1, listener):
        graph.add(2)
        assert not sender.covers(2, 0)
        graph.remove(2)
        assert sender.covers(1, 0)


def test_a_subscription_of_this_process_without_a_buffer_needs_dds(
    graph: Graph, sender: LocalSender
) -> None:
    graph.add(1)
    graph.endpoints = [replace(graph.endpoints[0], gid=PUBLISHER[:12] + bytes(4))]
    assert sender.covers(1, 1)
    assert not sender.covers(1, 0)


def test_subscriptions_that_dds_does_not_match_are_not_reached(
    folder: SocketFolder, graph: Graph
) -> None:
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    sender = make_sender(folder, best_effort)
    graph.add(1, reliable=False)
    graph.add(2)
    graph.add(3, reliable=False, type_name="x/msg/Other")
    with (
        folder.listen(gid(1), DEPTH) as listener,
        folder.listen(gid(2), DEPTH),
        folder.listen(gid(3), DEPTH),
        confirmed(sender, 1, listener),
    ):
        assert [peer.gid for peer in sender.peers] == [gid(1)]
    sender.close(0.0)


def test_publishers_that_are_destroyed_together_share_the_time_to_wait() -> None:
    publishers = [MagicMock(spec=IntraProcessPublisher) for _ in range(3)]
    disconnect_all([*publishers, MagicMock(spec=Publisher)])
    assert len({call.args for each in publishers for call in each.disconnect.mock_calls}) == 1


def test_a_large_message_is_left_to_dds(
    folder: SocketFolder, graph: Graph, sender: LocalSender
) -> None:
    graph.add(1)
    with folder.listen(gid(1), DEPTH) as listener, confirmed(sender, 1, listener):
        assert sender.send(bytes(LARGEST_MESSAGE))
        assert not sender.send(bytes(LARGEST_MESSAGE + 1))


def test_a_subscription_that_received_by_socket_drops_the_dds_message(
    folder: SocketFolder, graph: Graph, sender: LocalSender
) -> None:
    graph.add(1)
    graph.add(2)
    with (
        folder.listen(gid(1), DEPTH) as one,
        folder.listen(gid(2), DEPTH) as other,
        confirmed(sender, 2, one, other) as connections,
    ):
        ends = dict(zip((gid(1), gid(2)), connections, strict=True))
        first, last = sender.peers
        ends[last.gid].close()
        assert not sender.send(b"message")
        sender.send_through_dds(nothing)
        assert contents(ends[first.gid].recv(100)) == (b"message", 1)
        assert ends[first.gid].recv(100) == packed_number(2)
        ends[first.gid].close()
    assert not sender.covers(2, 0)


def test_a_subscription_whose_process_was_killed_needs_no_dds(
    folder: SocketFolder, path: Path, graph: Graph, sender: LocalSender
) -> None:
    program = (
        "import socket, sys\n"
        "own = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)\n"
        "own.bind(sys.argv[1])\n"
        "own.listen()\n"
        "print(flush=True)\n"
        f"own.accept()[0].send({CONFIRMATION!r})\n"
        "sys.stdin.read()\n"
    )
    graph.add(1)
    peer = subprocess.Popen(
        [sys.executable, "-c", program, f"{gid(1).hex()}-{DEPTH}"],
        cwd=path,  # the whole path may be longer than an address
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    with peer:
        assert peer.stdout is not None
        peer.stdout.readline()
        eventually(lambda: sender.covers(1, 0), "the bypass")
        peer.kill()
        peer.wait()
    assert not sender.send(b"message")
    assert sender.covers(1, 0)
    assert sender.peers == ()
    graph.remove(1)
    graph.add(3)  # DDS has replaced it
    sender._next_check_s = 0.0
    assert not sender.covers(1, 0)
    graph.remove(3)
    assert not sender.covers(0, 0)
    graph.add(2)
    assert not sender.covers(1, 0)  # another one, although the count is the same


@pytest.mark.parametrize("free", [0, 1, 2])
def test_without_free_descriptors_dds_delivers(
    folder: SocketFolder, graph: Graph, sender: LocalSender, free: int
) -> None:
    graph.add(1)
    with folder.listen(gid(1), DEPTH) as listener:
        before, lowest = open_descriptors(), lowest_free(listener)
        limits = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (lowest + free, limits[1]))
        try:
            assert not sender.covers(1, 0)
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, limits)
        assert sender.peers == ()
        assert open_descriptors() == before


def open_descriptors() -> int:
    gc.collect()  # sockets of earlier tests
    return len(list(Path("/proc/self/fd").iterdir()))


def lowest_free(opened: socket.socket) -> int:
    """The number of the next descriptor."""
    with opened.dup() as copy:
        return copy.fileno()


def test_a_subscription_that_does_not_read_gets_the_latest_messages_later() -> None:
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    near.setblocking(False)
    peer = Peer(near, gid(1), 3, bytes(GREETING))
    with far:
        assert greeting_of(far.recv(100)) == GREETING
        for number in range(1000):
            assert peer.send(packed_number(number))
        far.settimeout(10)
        got = [number_of(far.recv(100))]
        while got[-1] != 999:
            got.append(number_of(far.recv(100)))
        assert got[-3:] == [997, 998, 999]
        assert got[:-3] == list(range(len(got) - 3))
        peer.close()


def full(depth: int) -> tuple[Peer, socket.socket, int]:
    """A connection in which the last of the packets sent waits; its other end, and their number."""
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    near.setblocking(False)
    peer, sent = Peer(near, gid(1), depth, bytes(GREETING)), 0
    far.settimeout(10)
    assert greeting_of(far.recv(100)) == GREETING
    while not peer._waiting:
        sent += 1
        assert peer.send(packet(sent, 0))
    return peer, far, sent


def test_a_single_waiting_packet_is_sent_when_the_subscription_reads() -> None:
    peer, far, sent = full(DEPTH)
    with far:
        received = [far.recv(100) for _ in range(sent)]
    assert received == [packet(value, 0) for value in range(1, sent + 1)]
    peer.close()


def test_packets_do_not_overtake_waiting_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sender_module, "flusher_of", MagicMock())  # flushed below
    peer, far, sent = full(DEPTH)
    with far:
        received = [far.recv(100) for _ in range(sent - 1)]
        assert peer.send(packet(sent + 1, 0))
        assert not peer.flush()
        received += [far.recv(100) for _ in range(2)]
    assert received == [packet(value, 0) for value in range(1, sent + 2)]
    peer.close()


def test_a_connection_lost_while_packets_wait_takes_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sender_module, "flusher_of", MagicMock())  # flushed below
    peer, far, sent = full(DEPTH)
    far.close()
    assert not peer.flush()
    assert not peer.send(packet(sent + 1, 0))
    peer.close()


def test_closing_a_connection_sends_what_waits_and_takes_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sender_module, "flusher_of", MagicMock())
    peer, far, sent = full(DEPTH)
    with far:
        for _ in range(sent - 1):
            far.recv(100)
        peer.close()
        assert far.recv(100) == packet(sent, 0)
        assert far.recv(100) == b""
    peer, far, sent = full(DEPTH)
    with far:
        peer.close()
        assert not peer.send(packet(sent + 1, 0))


class Waiting:
    """A connection that waits for its socket."""

    def __init__(self, near: socket.socket) -> None:
        self._near = near
        self.is_flushed = False

    def fileno(self) -> int:
        return self._near.fileno()

    def flush(self) -> bool:
        self.is_flushed = True
        return False


def test_a_connection_that_is_no_longer_used_does_not_stop_the_others() -> None:
    flusher, pairs = Flusher(), [socket.socketpair() for _ in range(2)]
    for near, far in pairs:
        near.setblocking(False)
        far.setblocking(False)
        with suppress(BlockingIOError):
            while True:
                near.send(bytes(4096))
    flusher.watch(Waiting(pairs[0][0]))
    used = Waiting(pairs[1][0])
    flusher.watch(used)
    for _, far in pairs:
        with suppress(BlockingIOError):
            while True:
                far.recv(4096)
    eventually(lambda: used.is_flushed, "the other connection")
    for near, far in pairs:
        near.close()
        far.close()


def test_closed_connections_to_subscriptions_that_do_not_read_keep_no_descriptors() -> None:
    sender_module.flusher_of(os.getpid())
    before, others = open_descriptors(), []
    for _ in range(5):
        near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        near.setblocking(False)
        peer = Peer(near, gid(1), DEPTH, bytes(GREETING))
        while not peer._waiting:
            peer.send(packet(1, 0))
        peer.close()
        far.close()
        del peer
        others.append(os.open(os.devnull, os.O_RDONLY))  # reuses the number
    assert open_descriptors() == before + len(others)
    for descriptor in others:
        os.close(descriptor)


class Reader:
    """The messages that DDS holds for the subscription."""

    def __init__(self) -> None:
        self.samples: deque[Sample] = deque()

    def hold(self, value: int, number: int, publisher: bytes = PUBLISHER) -> None:
        self.samples.append(Sample(PACK(Int64(data=value)), publisher, number, 0, 0))

    def take(self) -> Sample | None:
        return self.samples.popleft() if self.samples else None


class Subscription:
    """A receiver with a publisher's end of a connection."""

    def __init__(self, folder: SocketFolder, qos: QoSProfile) -> None:
        assert CODEC is not None
        self.dds = Reader()
        self.buffer = MessageBuffer(Int64, qos, CODEC)
        self.worker = Worker()
        self.dds_reader = MagicMock(take=self.dds.take)
        self.receiver = LocalReceiver(folder, gid(1), self.buffer, self.dds_reader)
        self.worker.add(self.receiver, shared=False)
        self.depth = qos.depth
        self._folder = folder

    def connect(self, publisher: bytes = PUBLISHER) -> socket.socket:
        connection = self._folder.connect(gid(1), self.depth)
        assert connection is not None
        connection.send(bytes(Greeting(publisher=publisher, packets=GREETING.packets)))
        return connection

    def connect_with_page(self) -> "tuple[socket.socket, memoryview[int]]":
        """Connect a publisher that has sent nothing yet; return its page, too."""
        connection = self._folder.connect(gid(1), self.depth)
        assert connection is not None
        descriptor, page = new_page()
        socket.send_fds(connection, [bytes(Greeting(publisher=PUBLISHER, packets=0))], [descriptor])
        os.close(descriptor)
        return connection, page

    def read(self) -> None:
        """Read from the sockets."""
        for _ in range(3):  # the socket, then its connections, then the rest
            self.worker.run_ready(0)

    def taken(self) -> list[int]:
        """All messages that can be delivered now."""
        values = []
        while (taken := self.receiver.take()) is not None:
            values.append(taken[0].data)
        return values

    def close(self) -> None:
        self.receiver.stop()
        self.worker.remove(self.receiver)
        self.receiver.close()
        self.worker.close()


@pytest.fixture
def subscription(folder: SocketFolder) -> Iterator[Subscription]:
    made = Subscription(folder, QoSProfile(depth=DEPTH))
    yield made
    made.close()


def packet(value: int, number: int) -> bytes:
    return stamped(PACK(Int64(data=value)), number)


def test_packets_are_delivered_in_their_order(subscription: Subscription) -> None:
    with subscription.connect() as publisher:
        for value in range(5):
            publisher.send(packet(value, 0))
        subscription.read()
        assert subscription.taken() == [0, 1, 2, 3, 4]


def test_a_packet_waits_for_earlier_dds_messages(subscription: Subscription) -> None:
    with subscription.connect() as publisher:
        publisher.send(packet(3, 2))
        subscription.read()
        assert subscription.taken() == []
        subscription.dds.hold(1, 1)
        assert subscription.taken() == [1]
        subscription.dds.hold(2, 2)
        assert subscription.taken() == [2, 3]
        publisher.send(packet(4, 2))
        subscription.read()
        assert subscription.taken() == [4]


def test_messages_taken_before_the_connection_are_known(subscription: Subscription) -> None:
    subscription.dds.hold(1, 7)
    assert subscription.taken() == [1]
    with subscription.connect() as publisher:
        publisher.send(packet(2, 7))
        subscription.read()
        assert subscription.taken() == [2]


def test_packets_precede_later_dds_messages(subscription: Subscription) -> None:
    with subscription.connect() as publisher:
        subscription.read()
        publisher.send(packet(1, 0))
        publisher.send(packet(2, 0))
        subscription.dds.hold(3, 1)
        publisher.send(packet(4, 1))
        assert subscription.taken() == [1, 2, 3, 4]


def test_a_message_of_dds_waits_for_packets_that_the_socket_did_not_take(
    folder: SocketFolder,
) -> None:
    """They fill the socket several times."""
    subscription = Subscription(folder, QoSProfile(depth=3000))
    connection = folder.connect(gid(1), 3000)
    assert connection is not None
    peer = Peer(connection, gid(1), 3000, bytes(Greeting(publisher=PUBLISHER, packets=0)))
    for value in range(1, 2001):
        assert peer.send(stamped(PACK(Int64(data=value)), 0, value))
    peer.precede(2000)
    subscription.dds.hold(2001, 1)
    got: list[int] = []

    def all_have_arrived() -> bool:
        subscription.worker.run_ready(0.01)
        got.extend(subscription.taken())
        return len(got) >= 2001

    eventually(all_have_arrived, "all messages")
    assert got == list(range(1, 2002))
    peer.close()
    subscription.close()


def test_after_a_stall_only_the_messages_of_the_history_are_received(
    folder: SocketFolder, subscription: Subscription, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sender_module, "flusher_of", MagicMock())  # flushed below
    connection = folder.connect(gid(1), DEPTH)
    assert connection is not None
    peer = Peer(connection, gid(1), DEPTH, bytes(Greeting(publisher=PUBLISHER, packets=0)))
    subscription.read()
    for last in (1000, 2000):
        for value in range(last - 999, last + 1):
            assert peer.send(stamped(PACK(Int64(data=value)), 0, value))
        subscription.read()
        assert not subscription.taken()
        assert not peer.flush()
        subscription.read()
        assert subscription.taken() == list(range(last + 1 - DEPTH, last + 1))
    assert peer.send(stamped(PACK(Int64(data=2001)), 0, 2001))
    subscription.read()
    assert subscription.taken() == [2001]
    peer.close()


def test_a_message_that_came_by_a_packet_is_dropped_even_if_that_is_known_late(
    subscription: Subscription,
) -> None:
    connection, page = subscription.connect_with_page()
    with connection:
        connection.send(stamped(PACK(Int64(data=1)), 0, 1))
        # The next packet does not fit into the socket.
        page[1] = 1
        subscription.dds.hold(1, 1)
        assert subscription.taken() == [1]
        connection.send(packed_number(1))
        connection.send(stamped(PACK(Int64(data=2)), 1, 1))
        subscription.read()
        assert subscription.taken() == [2]


def test_another_publisher_does_not_hold_packets_up(subscription: Subscription) -> None:
    with subscription.connect() as publisher:
        publisher.send(packet(1, 0))
        subscription.read()
        subscription.dds.hold(2, 9, bytes(16))
        assert subscription.taken() == [1, 2]


def test_a_message_that_came_by_a_packet_is_dropped_when_dds_has_it(
    subscription: Subscription,
) -> None:
    with subscription.connect() as publisher:
        subscription.read()
        publisher.send(packet(1, 0))
        publisher.send(packed_number(1))
        subscription.dds.hold(1, 1)
        publisher.send(packet(2, 1))
        assert subscription.taken() == [1, 2]


def test_a_packet_does_not_wait_for_ever_for_a_message_that_dds_lost(
    folder: SocketFolder,
) -> None:
    subscription = Subscription(folder, best_effort())
    got: list[int] = []

    def has_arrived() -> list[int]:
        subscription.worker.run_ready(0.01)
        got.extend(subscription.taken())
        return got

    with subscription.connect() as publisher:
        publisher.send(packet(1, 5))
        subscription.read()
        assert subscription.taken() == []
        eventually(has_arrived, "the packet")
        publisher.send(packet(2, 5))
        subscription.read()
        assert subscription.taken() == [2]
    subscription.close()


def best_effort(depth: int = DEPTH) -> QoSProfile:
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.mark.parametrize("depth", [1, 2, DEPTH])
def test_frequent_packets_do_not_extend_the_wait_for_a_lost_message(
    folder: SocketFolder, depth: int
) -> None:
    subscription = Subscription(folder, best_effort(depth))
    with subscription.connect() as publisher:

        def has_arrived() -> list[int]:
            publisher.send(packet(1, 5))
            subscription.worker.run_ready(0.001)
            return subscription.taken()

        eventually(has_arrived, "a packet")
    subscription.close()


def test_the_waits_of_two_publishers_are_independent(folder: SocketFolder) -> None:
    subscription = Subscription(folder, best_effort())
    other, got = bytes(16), set[int]()
    numbers = iter(range(1, 1_000_000))
    with subscription.connect() as first, subscription.connect(other) as second:
        subscription.dds.hold(0, 1)
        subscription.dds.hold(0, 1, other)
        subscription.taken()
        first.send(packet(7, 9))  # the message before it is lost

        def has_arrived() -> bool:
            number = next(numbers) + 1
            second.send(packet(8, number))
            subscription.read()
            subscription.dds.hold(8, number, other)
            subscription.worker.run_ready(0.001)
            got.update(subscription.taken())
            return 7 in got

        eventually(has_arrived, "the packet of the first publisher")
    subscription.close()


def test_a_later_wait_ends_after_an_earlier_one(folder: SocketFolder) -> None:
    subscription = Subscription(folder, best_effort())
    got: list[int] = []

    def have_arrived() -> bool:
        subscription.worker.run_ready(0.01)
        got.extend(subscription.taken())
        return len(got) == 2

    with subscription.connect() as first, subscription.connect(bytes(16)) as second:
        first.send(packet(1, 5))
        subscription.read()
        subscription.receiver._inbox._wait_s *= 4
        second.send(packet(2, 5))
        subscription.read()
        eventually(have_arrived, "both packets")
    assert got == [1, 2]
    subscription.close()


def test_a_closed_receiver_keeps_no_descriptors_and_no_subscription(folder: SocketFolder) -> None:
    before = open_descriptors()
    subscription = Subscription(folder, best_effort())
    subscription.connect().close()
    subscription.close()
    subscription.dds_reader.close.assert_called_once_with()
    del subscription
    assert open_descriptors() == before


def test_late_packets_do_not_follow_newer_messages(folder: SocketFolder) -> None:
    subscription = Subscription(folder, best_effort())
    connection, page = subscription.connect_with_page()
    with connection:
        subscription.read()
        page[0] = 3  # these packets are still waiting in the publisher
        subscription.dds.hold(4, 1)
        assert subscription.taken() == []

        def has_arrived() -> bool:
            subscription.worker.run_ready(0.01)
            return subscription.taken() == [4]

        eventually(has_arrived, "the message from DDS")
        for value in (1, 2, 3):
            connection.send(stamped(PACK(Int64(data=value)), 0, value))
        connection.send(stamped(PACK(Int64(data=5)), 1, 4))
        subscription.read()
        assert subscription.taken() == [5]
    subscription.close()


def test_a_reliable_subscription_waits_for_all_packets(
    folder: SocketFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inbox, "_RELIABLE_WAIT_S", 0.01)
    subscription = Subscription(folder, QoSProfile(depth=DEPTH))
    connection, page = subscription.connect_with_page()
    with connection:
        subscription.read()
        page[0] = 3
        subscription.dds.hold(4, 1)
        assert subscription.taken() == []
        for _ in range(5):
            subscription.worker.run_ready(0.03)
            assert subscription.taken() == []
        for value in (1, 2, 3):
            connection.send(stamped(PACK(Int64(data=value)), 0, value))
        subscription.read()
        assert subscription.taken() == [1, 2, 3, 4]
    subscription.close()


def test_a_waiting_packet_is_withdrawn_if_dds_delivers_its_message(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sender_module, "flusher_of", MagicMock())  # flushed below
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    near.setblocking(False)
    peer = Peer(near, gid(1), 1, bytes(GREETING))
    with far:
        sent = 0
        while not peer._waiting:
            sent += 1
            assert peer.send(packet(sent, 0))
        peer.skip(1)
        assert greeting_of(far.recv(100)) == GREETING
        received = [far.recv(100) for _ in range(sent - 1)]
        assert received == [packet(value, 0) for value in range(1, sent)]
        assert not peer.flush()
        far.setblocking(False)
        with pytest.raises(BlockingIOError):
            far.recv(100)
        peer.close()


def test_only_the_latest_messages_are_kept(subscription: Subscription) -> None:
    with subscription.connect() as publisher:
        for value in range(DEPTH + 5):
            if value == DEPTH:
                subscription.read()
            publisher.send(packet(value, 0))
        subscription.read()
        assert subscription.taken() == list(range(5, DEPTH + 5))


@pytest.mark.parametrize("is_accepted", [True, False], ids=["connected", "not accepted yet"])
def test_messages_sent_before_a_stop_are_kept_and_later_ones_cannot_be_sent(
    folder: SocketFolder, path: Path, is_accepted: bool
) -> None:
    subscription = Subscription(folder, QoSProfile(depth=DEPTH))
    publisher = subscription.connect()
    if is_accepted:
        subscription.read()
    publisher.send(packet(1, 0))
    subscription.receiver.stop()
    with pytest.raises(OSError, match="Broken pipe"):
        publisher.send(packet(2, 0))
    assert subscription.taken() == [1]
    assert not list(path.iterdir())
    subscription.worker.remove(subscription.receiver)
    subscription.receiver.close()
    subscription.worker.close()
    publisher.close()


def test_messages_sent_during_a_stop_keep_their_order(
    subscription: Subscription, monkeypatch: pytest.MonkeyPatch
) -> None:
    with subscription.connect() as publisher:
        subscription.read()
        remove = SocketFolder.remove

        def publish_first(folder: SocketFolder, gid: bytes, depth: int) -> None:
            subscription.dds.hold(1, 1)
            publisher.send(packet(2, 1))
            remove(folder, gid, depth)

        monkeypatch.setattr(SocketFolder, "remove", publish_first)
        subscription.receiver.stop()
        monkeypatch.undo()
        assert subscription.taken() == [1, 2]


def test_a_publisher_that_leaves_is_forgotten_and_its_messages_stay(
    subscription: Subscription,
) -> None:
    publisher = subscription.connect()
    publisher.send(packet(1, 0))
    publisher.close()
    subscription.read()
    assert subscription.taken() == [1]
    assert subscription.receiver._inbox.connections == []


@pytest.mark.parametrize("packets", [[b"GET / HTTP/1.1\r\n"], [bytes(20)], [bytes(GREETING), b"x"]])
def test_a_publisher_that_does_not_keep_to_the_protocol_is_disconnected(
    subscription: Subscription, packets: list[bytes]
) -> None:
    connection = subscription._folder.connect(gid(1), DEPTH)
    assert connection is not None
    for each in packets:
        connection.send(each)
    subscription.read()
    assert subscription.receiver._inbox.connections == []
    assert subscription.taken() == []
    connection.close()
