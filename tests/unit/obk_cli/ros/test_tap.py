"""Sequence numbers of a tap: a gap is a lost message."""

from collections import deque
from pathlib import Path
from unittest.mock import MagicMock

import pytest

from obelisk_spec.local_transport.dds_reader import Sample
from obelisk_spec.local_transport.sockets import Greeting, SocketFolder, packed_stamp
from obk_cli.ros import raw_subscription
from obk_cli.ros.raw_subscription import DropCounter, Tap

GID = bytes(16)
PUBLISHER = bytes(range(16))
DEPTH = 10


def test_packets_from_before_the_connection_are_no_gap(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dds = deque(Sample(b"", PUBLISHER, number, 0, 0) for number in (1, 2))
    reader = MagicMock(take=lambda: dds.popleft() if dds else None)
    monkeypatch.setattr(raw_subscription, "DdsReader", lambda _handle: reader)
    tmp_path.chmod(0o700)
    folder = SocketFolder(str(tmp_path))
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
