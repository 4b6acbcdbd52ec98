"""Recordings written, cut off anywhere, read back and drawn; no ROS is running."""

import struct
from pathlib import Path

import pytest
from mcap.reader import make_reader

from obk_cli.adapters.bag_reader import messages_of, read_bag
from obk_cli.adapters.bag_writer import BagWriter
from obk_cli.adapters.picture import draw
from obk_cli.errors import CommandFailedError
from obk_cli.recording.bag import BagTopic
from obk_cli.recording.fields import Lines, parse_field
from obk_cli.recording.tally import DROPS

TYPE = "std_msgs/msg/Float64"
BEGIN_NS = 1_700_000_000_000_000_000
COUNT = 100


def message(value: float) -> bytes:
    """Serialized as CDR, little-endian."""
    return b"\0\1\0\0" + struct.pack("<d", value)


def written(path: Path) -> Path:
    with BagWriter(path) as writer:
        writer.describe({"obelisk": {"run": "arm"}}, {"plan.json": "{}"}, BEGIN_NS)
        channel = writer.add_topic(
            "/speed", TYPE, "float64 data\n", {"topic_type_hash": "RIHS01_0"}
        )
        silent = writer.add_topic("/silent", TYPE, "float64 data\n", {})
        assert channel != silent
        for number in range(COUNT):
            time_ns = BEGIN_NS + number * 10_000_000
            writer.add_message(channel, message(number), time_ns, time_ns - 1, number + 1)
            if number % 10 == 9:
                writer.flush()
        writer.describe({DROPS: {"/speed": "3"}}, {}, BEGIN_NS)
    return path


def test_a_recording_tells_what_is_in_it(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap")
    bag = read_bag(path)
    assert bag.is_complete
    assert (bag.profile, bag.count, bag.start_ns) == ("ros2", COUNT, BEGIN_NS)
    assert bag.duration_s == pytest.approx(0.99)
    assert bag.topics == (
        BagTopic(topic="/silent", msg_type=TYPE, count=0),
        BagTopic(topic="/speed", msg_type=TYPE, count=100, dropped=3, type_hash="RIHS01_0"),
    )
    assert bag.metadata == {"obelisk": {"run": "arm"}}
    assert bag.attachments == {"plan.json": 2}


def test_what_was_made_from_stands_before_the_messages(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap")
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    first_chunk = min(index.chunk_start_offset for index in summary.chunk_indexes)
    assert all(index.offset < first_chunk for index in summary.attachment_indexes)
    assert min(index.offset for index in summary.metadata_indexes) < first_chunk


def test_messages_come_back_by_the_definitions_in_the_file(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap")
    got = list(messages_of(path, {"/speed"}))
    assert [one.value.data for one in got] == [float(n) for n in range(COUNT)]
    assert got[1].received_ns == BEGIN_NS + 10_000_000
    assert got[1].published_ns == BEGIN_NS + 10_000_000 - 1
    assert list(messages_of(path, {"/silent"})) == []


@pytest.mark.parametrize("part", [0.0, 0.001, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 0.9999])
def test_a_file_that_breaks_off_anywhere_is_read_up_to_there(tmp_path: Path, part: float) -> None:
    whole = written(tmp_path / "a.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: int(len(whole) * part)])
    bag = read_bag(cut)
    assert not bag.is_complete
    values = [one.value.data for one in messages_of(cut, {"/speed"})]
    assert values == [float(n) for n in range(bag.count)]
    assert bag.count % 10 == 0


def test_what_was_flushed_is_there_without_an_end(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer = BagWriter(path)
    channel = writer.add_topic("/speed", TYPE, "float64 data\n", {})
    writer.add_message(channel, message(1.0), BEGIN_NS, BEGIN_NS, 1)
    assert read_bag(path).count == 0
    writer.flush()
    assert read_bag(path).count == 1
    writer.close()
    assert read_bag(path).is_complete


def test_a_file_that_is_there_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("mine")
    with pytest.raises(CommandFailedError, match="is there already"):
        BagWriter(path)
    assert path.read_text() == "mine"


def test_what_is_no_recording_is_told(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("some text that is no recording")
    with pytest.raises(CommandFailedError, match="is no MCAP file"):
        read_bag(path)
    with pytest.raises(CommandFailedError, match="there is no such file"):
        read_bag(tmp_path / "b.mcap")


def speed_lines(path: Path) -> Lines:
    lines = Lines(parse_field("/speed.data"))
    for one in messages_of(path, {"/speed"}):
        lines.add((one.received_ns - BEGIN_NS) * 1e-9, one.value)
    return lines


def test_a_field_is_drawn_as_png_and_as_svg_the_same_bytes_each_time(tmp_path: Path) -> None:
    lines = speed_lines(written(tmp_path / "a.mcap"))
    for name, begin in (("a.png", b"\x89PNG"), ("a.svg", b"<?xml")):
        draw([lines, lines], "a title", tmp_path / name)
        first = (tmp_path / name).read_bytes()
        assert first.startswith(begin)
        draw([lines, lines], "a title", tmp_path / name)
        assert (tmp_path / name).read_bytes() == first
    svg = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert svg.count(">/speed.data<") == 2
    assert ">a title<" in svg


def test_a_picture_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    lines = speed_lines(written(tmp_path / "a.mcap"))
    with pytest.raises(CommandFailedError, match="there is no such file"):
        draw([lines], "t", tmp_path / "no" / "a.png")
