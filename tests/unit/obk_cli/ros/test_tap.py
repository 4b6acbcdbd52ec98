"""The numbers of messages from a tap, in which a gap is a loss, and their times of receipt."""

from collections import deque
from collections.abc import Iterator, Mapping
from pathlib import Path
from socket import socket
from unittest.mock import MagicMock

import pytest

from obelisk_spec.local_transport.dds_reader import Sample
from obelisk_spec.local_transport.sockets import Greeting, SocketFolder, packed_stamp
from obk_cli.ros import raw_subscription
from obk_cli.ros.raw_subscription import DropCounter, Tap

GID = bytes(16)
PUBLISHER = bytes(range(16))
DEPTH = 10


@pytest.fixture
def dds() -> deque[Sample]:
    """Messages that wait in DDS."""
    return deque()


@pytest.fixture
def reader(dds: deque[Sample], monkeypatch: pytest.MonkeyPatch) -> MagicMock:
    reader = MagicMock(take=lambda: dds.popleft() if dds else None)
    monkeypatch.setattr(raw_subscription, "DdsReader", lambda _handle: reader)
    return reader


@pytest.fixture
def folder(tmp_path: Path) -> SocketFolder:
    tmp_path.chmod(0o700)
    return SocketFolder(str(tmp_path))


def test_packets_from_before_the_connection_are_no_gap(
    folder: SocketFolder, dds: deque[Sample], reader: MagicMock
) -> None:
    dds += (Sample(b"", PUBLISHER, number, 0, 0) for number in (1, 2))
    tap, drops = Tap(folder, GID, None, DEPTH), DropCounter()

    def count_all() -> None:
        for _ in range(DEPTH):  # the socket, its connection, each message
            if (taken := tap.take()) is not None:
                drops.take(taken[1]["publication_sequence_number"], 1)

    count_all()
    connection = folder.connect(GID, DEPTH)
    assert connection is not None
    with connection:
        connection.send(bytes(Greeting(publisher=PUBLISHER, packets=1000)))
        for packets in (1001, 1002):
            connection.send(packed_stamp(0, packets, 2))
        count_all()
        assert (drops.count, drops.dropped) == (4, 0)
        connection.send(packed_stamp(0, 1005, 2))
        count_all()
        assert (drops.count, drops.dropped) == (5, 2)
    tap.close()
    reader.close.assert_called_once_with()


@pytest.fixture
def tap(folder: SocketFolder, reader: MagicMock) -> Iterator[Tap]:
    tap = Tap(folder, GID, None, DEPTH)
    yield tap
    tap.close()
    reader.close.assert_called_once_with()


@pytest.fixture
def publisher(folder: SocketFolder, tap: Tap) -> Iterator[socket]:
    """The connection of a publisher that has sent nothing to others before."""
    connection = folder.connect(GID, DEPTH)
    assert connection is not None
    with connection:
        connection.send(bytes(Greeting(publisher=PUBLISHER, packets=0)))
        assert tap.take() is None  # accepts the connection
        yield connection


def infos_of(tap: Tap, count: int) -> list[Mapping[str, int]]:
    """Take messages and return what the tap reports of them."""
    return [taken[1] for _ in range(count) if (taken := tap.take()) is not None]


def test_messages_are_received_in_the_order_in_which_they_were_published(
    tap: Tap, publisher: socket, dds: deque[Sample]
) -> None:
    publisher.send(packed_stamp(20, 1, 1))
    assert tap.take() is None  # the packet waits for the message from DDS
    dds.append(Sample(b"", PUBLISHER, 1, published_ns=10, received_ns=30))
    infos = infos_of(tap, 2)
    publisher.send(packed_stamp(40, 2, 1))
    infos += infos_of(tap, 1)
    assert [info["source_timestamp"] for info in infos] == [10, 20, 40]
    assert [info["received_timestamp"] for info in infos] == [30, 30, 40]


def test_at_the_end_packets_do_not_wait_for_a_message_that_dds_lost(
    tap: Tap, publisher: socket
) -> None:
    for packets in (1, 2):
        publisher.send(packed_stamp(0, packets, 1))
    assert tap.take() is None
    publisher.close()
    tap.release()
    assert [info["publication_sequence_number"] for info in infos_of(tap, 3)] == [2, 3]


def test_a_message_through_dds_after_the_end_of_a_connection_is_no_gap(
    tap: Tap, publisher: socket, dds: deque[Sample]
) -> None:
    publisher.send(packed_stamp(0, 1, 0))
    publisher.send(packed_stamp(0, 2, 0))
    infos = infos_of(tap, 2)
    publisher.close()
    assert tap.take() is None  # notices that the connection is closed
    dds += (Sample(b"", PUBLISHER, number, 0, 0) for number in (1, 2))
    infos += infos_of(tap, 2)
    assert [info["publication_sequence_number"] for info in infos] == [1, 2, 3, 4]
