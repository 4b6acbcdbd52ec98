"""Messages of recordings, read with and without the indexes of their chunks."""

import struct
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from obelisk_recordings import chunks
from obelisk_recordings.chunks import messages_in_parts

TOPICS = ("/a", "/b", "/late")
Read = dict[str, list[tuple[int, bytes]]]


def record(path: Path, count: int = 400) -> Path:
    """Messages of two topics with several lengths; a third topic is added without a message."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=2_000, compression=CompressionType.NONE)
        writer.start()
        schema = writer.register_schema("pkg/msg/Text", "ros2msg", b"string text")
        a = writer.register_channel("/a", "cdr", schema)
        b = writer.register_channel("/b", "cdr", schema)
        late = 0
        for number in range(count):
            data = struct.pack("<I", number) * (1 + number % 3)
            writer.add_message(b if number % 4 == 0 else a, number, data, number)
            if number == count // 2:
                late = writer.register_channel("/late", "cdr", schema)
        writer.add_message(late, count, b"late", count)
        writer.finish()
    return path


def read(path: Path, topics: Iterable[str] = TOPICS) -> Read:
    found: Read = {}
    for part in messages_in_parts(path, frozenset(topics)):
        messages = found.setdefault(part.topic, [])
        rows = {
            int(at): row.tobytes()
            for places, rows in part.tables
            for at, row in zip(places, rows, strict=True)
        }
        messages += [(int(time), rows[at]) for at, time in enumerate(part.received_ns)]
    return found


def test_indexes_find_the_same_messages_as_a_walk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = record(tmp_path / "a.mcap")
    uses = []
    original = chunks._indexed_messages

    def counted(data: bytes, indexes: Iterable[chunks._RawIndex]) -> object:
        found = original(data, [*indexes])
        uses.append(found is not None)
        return found

    monkeypatch.setattr(chunks, "_indexed_messages", counted)
    indexed = read(path)
    assert sum(uses) > len(uses) / 2
    monkeypatch.setattr(chunks, "_indexed_messages", lambda _data, _indexes: None)
    assert read(path) == indexed
    assert {topic: len(messages) for topic, messages in indexed.items()} == {
        "/a": 300,
        "/b": 100,
        "/late": 1,
    }


@pytest.mark.parametrize("change", [0, 1, 9, 1 << 40, 1 << 63, (1 << 64) - 1])
def test_a_wrong_index_is_not_used(tmp_path: Path, change: int) -> None:
    path = record(tmp_path / "a.mcap")
    known = read(path)
    content = bytearray(path.read_bytes())
    offsets = [
        at + 9 + 6 + 8  # the offset of the first message in each index
        for at in range(len(content) - 9)
        if content[at] == 7 and struct.unpack_from("<Q", content, at + 1)[0] in range(22, 2000, 16)
    ]
    assert len(offsets) > 10
    for offset in offsets:
        struct.pack_into("<Q", content, offset, change)
    path.write_bytes(content)
    assert read(path) == known


def test_a_truncated_file_is_read_up_to_its_last_whole_chunk(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap")
    known = read(path)["/a"]
    content = path.read_bytes()
    lengths = []
    for size in np.linspace(100, len(content), 40, dtype=int):
        path.write_bytes(content[:size])
        found = read(path, ["/a"]).get("/a", [])
        assert found == known[: len(found)]
        lengths.append(len(found))
    assert lengths == sorted(lengths)
    assert lengths[-1] == len(known)
