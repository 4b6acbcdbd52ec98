"""Recordings written, truncated anywhere, read back and plotted, without ROS."""

import errno
import os
import re
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from obelisk_recordings.bag import DROPS, BagTopic, RecordingError
from obelisk_recordings.run import open_run
from obelisk_recordings.summary import read_bag
from obk_cli.cli.bag import bag_text
from obk_cli.errors import CommandFailedError
from obk_cli.record.mcap_writer import BagWriter, offers_text
from obk_cli.record.plot import PlotPart, draw, parse_field, plot_parts
from obk_cli.ros.raw_subscription import OfferedQos

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


def test_a_recording_reports_its_content(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap")
    bag = read_bag(path)
    assert bag.is_complete
    assert (bag.profile, bag.count, bag.start_ns) == ("ros2", COUNT, BEGIN_NS)
    assert bag.duration_s == pytest.approx(0.99)
    assert bag.topics == (
        BagTopic(topic="/silent", msg_type=TYPE, count=0),
        BagTopic(topic="/speed", msg_type=TYPE, count=100, lost=3, type_hash="RIHS01_0"),
    )
    assert bag.metadata == {"obelisk": {"run": "arm"}}
    assert bag.attachments == {"plan.json": 2}


def test_the_config_precedes_the_messages(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap")
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    first_chunk = min(index.chunk_start_offset for index in summary.chunk_indexes)
    assert all(index.offset < first_chunk for index in summary.attachment_indexes)
    assert min(index.offset for index in summary.metadata_indexes) < first_chunk


def test_messages_are_read_by_the_definitions_in_the_file(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap")
    run = open_run(path)
    assert run["/speed"].data.tolist() == [float(n) for n in range(COUNT)]
    assert run["/speed"].messages.received_ns[1] == BEGIN_NS + 10_000_000
    assert run["/speed"].messages.published_ns[1] == BEGIN_NS + 10_000_000 - 1
    assert run.read(["/silent"]) == {}


@pytest.mark.parametrize("part", [0.0, 0.001, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 0.9999])
def test_a_truncated_file_is_read_up_to_any_end(tmp_path: Path, part: float) -> None:
    whole = written(tmp_path / "a.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: int(len(whole) * part)])
    bag = read_bag(cut)
    assert not bag.is_complete
    values = [value for one in open_run(cut).parts(["/speed"]) for value in one.data]
    assert values == [float(n) for n in range(bag.count)]
    assert bag.count % 10 == 0


@pytest.mark.parametrize("content", [b"text", b"a text of more than eight bytes"])
def test_a_file_of_another_format_is_no_recording(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "text.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="is not an MCAP file"):
        read_bag(path)


def test_a_damaged_chunk_is_an_error_of_the_file(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap")
    with path.open("r+b") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        chunk = summary.chunk_indexes[0]
        end = chunk.chunk_start_offset + chunk.chunk_length
        file.seek(end - 40)
        file.write(b"\xff" * 40)
    assert read_bag(path).count == COUNT
    with pytest.raises(RecordingError, match=r"a\.mcap"):
        open_run(path).read(["/speed"])


def test_flushed_messages_exist_without_an_end(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer = BagWriter(path)
    channel = writer.add_topic("/speed", TYPE, "float64 data\n", {})
    writer.add_message(channel, message(1.0), BEGIN_NS, BEGIN_NS, 1)
    assert read_bag(path).count == 0
    writer.flush()
    assert read_bag(path).count == 1
    writer.close()
    assert read_bag(path).is_complete


def test_an_existing_file_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("mine")
    with pytest.raises(CommandFailedError, match=r"a\.mcap"):
        BagWriter(path)
    assert path.read_text() == "mine"


def test_invalid_recordings_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("some text that is no recording")
    with pytest.raises(RecordingError, match="MCAP"):
        read_bag(path)
    with pytest.raises(RecordingError, match=r"b\.mcap"):
        read_bag(tmp_path / "b.mcap")


def speed_lines(path: Path) -> tuple[PlotPart, ...]:
    return plot_parts([open_run(path)], [parse_field("/speed.data")])


def test_a_field_is_drawn_as_png_and_as_svg_reproducibly(tmp_path: Path) -> None:
    (lines,) = speed_lines(written(tmp_path / "a.mcap"))
    for name, begin in (("a.png", b"\x89PNG"), ("a.svg", b"<?xml")):
        draw([lines, lines], "a title", tmp_path / name)
        first = (tmp_path / name).read_bytes()
        assert first.startswith(begin)
        draw([lines, lines], "a title", tmp_path / name)
        assert (tmp_path / name).read_bytes() == first
    svg = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert svg.count(">/speed.data<") == 2
    assert ">a title<" in svg


def test_a_picture_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    lines = speed_lines(written(tmp_path / "a.mcap"))
    (tmp_path / "a.png").mkdir()
    with pytest.raises(CommandFailedError, match=r"a\.png` cannot be written: it is a directory"):
        draw(lines, "t", tmp_path / "a.png")
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_an_existing_picture_is_kept_if_no_new_one_can_be_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    (tmp_path / "a.png").write_text("the one before")
    monkeypatch.setattr("os.fdopen", fail)
    with pytest.raises(CommandFailedError, match="no space left on device"):
        draw(speed_lines(written(tmp_path / "a.mcap")), "t", tmp_path / "a.png")
    assert (tmp_path / "a.png").read_text() == "the one before"


def test_a_recording_that_cannot_be_started_is_reported(tmp_path: Path) -> None:
    gone = re.escape(f"`{tmp_path}/no/a.mcap` cannot be written: the folder {tmp_path}/no does")
    with pytest.raises(CommandFailedError, match=gone):
        BagWriter(tmp_path / "no" / "a.mcap")


@pytest.mark.parametrize("compression", list(CompressionType))
def test_messages_of_overlapping_chunks_are_read_in_order_of_receipt(
    compression: CompressionType, tmp_path: Path
) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        made = Writer(file, compression=compression, chunk_size=100)
        made.start("ros2", "test")
        schema = made.register_schema(TYPE, "ros2msg", b"float64 data\n")
        speed = made.register_channel("/speed", "cdr", schema)
        other = made.register_channel("/other", "cdr", schema)
        for number in (5, 1, 9, 2, 8, 3, 7, 4, 6, 0, 2**64 - 1):
            made.add_message(speed, number, message(number), number)
            made.add_message(other, number, message(-1.0), number)
        made.finish()
    received = open_run(path)["/speed"].messages.received_ns.view(np.uint64).tolist()
    assert received == [*range(10), 2**64 - 1]
    with path.open("rb") as file:
        theirs = [m.log_time for _, _, m in make_reader(file).iter_messages(topics=["/speed"])]
    assert received == theirs


def test_times_beyond_any_calendar_are_shown(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with BagWriter(path) as writer:
        channel = writer.add_topic("/speed", TYPE, "float64 data\n", {})
        writer.add_message(channel, message(1.0), 2**64 - 1, 2**64 - 1, 1)
    bag = read_bag(path)
    assert (bag.count, bag.end_ns) == (1, 2**64 - 1)
    assert any("/speed" in line for line in bag_text(bag))


def with_definition(path: Path, definition: str, data: bytes) -> Path:
    with BagWriter(path) as writer:
        channel = writer.add_topic("/speed", "demo_msgs/msg/Reading", definition, {})
        writer.add_message(channel, b"\0\1\0\0" + data, BEGIN_NS, BEGIN_NS, 1)
    return path


@pytest.mark.parametrize(
    "line",
    [
        f"uint8 {'A' * 60}_=1",
        f"uint8 {'A' * 60}_b = 1  # {'[' * 60_000}",
        f"#{' ' * 60_000}x",
        'string TEXT="float64 other"',
    ],
)
def test_comments_and_constants_of_a_definition_do_not_count(tmp_path: Path, line: str) -> None:
    definition = f"{line}\nfloat64 data 1.5\n{line}\n"
    path = with_definition(tmp_path / "a.mcap", definition, struct.pack("<d", 2.5))
    assert open_run(path)["/speed"].data.tolist() == [2.5]


@pytest.mark.parametrize(
    ("definition", "data"),
    [
        ("uint8[] data\n", struct.pack("<I", 100) + b"few"),
        ("string data\n", struct.pack("<I", 100) + b"few"),
        (f"Id[] data\n{'=' * 80}\nMSG: demo_msgs/Id\nuint8[16] id\n", b"\xff" * 4),
    ],
)
def test_a_message_that_breaks_off_is_reported_and_not_cut_short(
    tmp_path: Path, definition: str, data: bytes
) -> None:
    path = with_definition(tmp_path / "a.mcap", definition, data)
    with pytest.raises(RecordingError, match=r"damaged: expected \d+ bytes"):
        _ = open_run(path)["/speed"]["data"]


def test_bytes_of_names_with_invalid_utf8_are_escaped(tmp_path: Path) -> None:
    name = os.fsdecode(b"caf\xe9")
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.describe({"obelisk": {"config": name}}, {"plan.json": name}, BEGIN_NS)
    assert read_bag(tmp_path / "a.mcap").metadata == {"obelisk": {"config": r"caf\udce9"}}


FOR_EVER = 2**63 - 1
OFFER = OfferedQos(
    history="keep_last",
    depth=10,
    reliability="reliable",
    durability="volatile",
    liveliness="automatic",
    deadline_ns=1_500_000_000,
    lifespan_ns=FOR_EVER,
    lease_ns=FOR_EVER,
)


def test_offered_qos_is_stored_in_the_format_of_rosbag2() -> None:
    first, second = yaml.safe_load(offers_text([OFFER, replace(OFFER, reliability="best_effort")]))
    assert first == {
        "history": "keep_last",
        "depth": 10,
        "reliability": "reliable",
        "durability": "volatile",
        "deadline": {"sec": 1, "nsec": 500_000_000},
        "lifespan": {"sec": 9223372036, "nsec": 854775807},
        "liveliness": "automatic",
        "liveliness_lease_duration": {"sec": 9223372036, "nsec": 854775807},
        "avoid_ros_namespace_conventions": False,
    }
    assert second["reliability"] == "best_effort"
